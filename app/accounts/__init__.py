"""People, teams, tokens and sessions."""
