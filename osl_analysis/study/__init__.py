"""The Monte Carlo study: are the estimators unbiased, efficient, and their intervals honest?"""
