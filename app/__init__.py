"""The evaluation service: accounts, uploads, the life cycle of submissions, and leaderboards."""
