"""The diagnosis in words and as documents."""
