"""What a recording becomes before it is compared: checked, on one clock, in blocks."""
