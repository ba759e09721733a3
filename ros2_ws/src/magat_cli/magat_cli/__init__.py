"""The magat command: one module for each verb."""
