"""The errors that are the user's to mend; free of ROS."""


class MagatError(Exception):
    """Something that the user can mend is wrong; the message says what, the value, and what to do.

    The ``magat`` command prints it in one line. Anything else that is raised is a defect.
    """


class TeamError(MagatError, RuntimeError):
    """The team cannot go on; the message says which process failed and what it said."""
