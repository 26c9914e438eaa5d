"""Faults on purpose: a graph whose driver, planner and processes fail when told to, and what comes of it."""
