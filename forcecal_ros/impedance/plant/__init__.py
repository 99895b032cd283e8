"""The plant as [Gamez2005] V models it: robot (Eq. 28) and tool on its slide (Eq. 29)."""
