"""One module a command of ``forcecal``: ``add_parser`` declares it, ``run`` carries it out."""
