"""Pictures and animations of episodes, and the colours that all pictures of the project share."""
