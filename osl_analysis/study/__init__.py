"""The Monte Carlo study: bias and efficiency of the estimators, and coverage of their intervals."""
