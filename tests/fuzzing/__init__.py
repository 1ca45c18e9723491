"""Every reader of files on changed files: no crash, no hang, little memory, one PalpateError at most."""
