"""A second rig, written from physics alone, and blind cases made with it.

Nothing here imports the package under test, and nothing there imports this.
"""
