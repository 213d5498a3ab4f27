"""Choose the exposures of a plan's brackets: their limits, the choice, and its range beforehand."""
