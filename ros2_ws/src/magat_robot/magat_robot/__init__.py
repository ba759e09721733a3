"""A robot: its policy (`policy`), its part in the exchange of messages (`crew`, `exchange`), and its node (`node`)."""
