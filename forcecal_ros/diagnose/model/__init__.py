"""The statistical model: simulation linearised in its parameters, noise, and a discrepancy."""
