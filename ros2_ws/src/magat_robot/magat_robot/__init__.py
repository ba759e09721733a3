"""What a robot carries: its copy of the policy, its side of the message exchange, and the node around them."""
