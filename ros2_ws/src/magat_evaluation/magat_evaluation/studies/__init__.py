"""Studies of the policies: what is measured for the page of results, and how it is shown."""
