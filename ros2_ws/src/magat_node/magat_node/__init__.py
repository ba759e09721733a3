"""What every node of the team does alike: quality of service, parameters, running until told to end."""
