"""The command line: click commands, each a few lines over study, store and report."""

import gc

# Commands make many objects that stay, and hardly any cyclic garbage, which is looked for less often.
gc.set_threshold(100_000, 20, 50)
