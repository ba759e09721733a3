"""Policies in POGEMA, the environment in which others compare theirs (Skrynnik et al., 2022)."""
