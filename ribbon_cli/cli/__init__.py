"""The command line: click commands, each a few lines over study, store and report."""
