"""What a recording can have wrong, found once where it enters: one function a check."""
