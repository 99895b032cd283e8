"""Many calibrations and diagnoses of many robots over time: what drifted, and what first."""
