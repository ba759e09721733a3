"""Pictures and animations of episodes, and the colour table of the project."""
