"""All of it together: the ``magat`` command, the processes of a team, the client that runs episodes, pictures."""
