"""Which effects explain the residual: fitted one by one, compared, accepted, dropped."""
