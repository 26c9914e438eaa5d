"""Does a driver speak the contract? Checks of what was heard of it, each with its mend: docs/vessel.md."""
