"""The second edition: backgrounds, other generators and noise; PROTOCOL.md says what it draws."""
