"""What is reported of pictures and times: metrics, profiles, and what a command waits for."""
