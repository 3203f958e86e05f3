"""What programs and notebooks do with bands, and the layer that the command line stands on.

Everything is imported when it is first asked for: `ribbon show` must not wait for what draws.
"""

from ribbon_cli.doors import door

__getattr__, __dir__ = door(__name__, __file__)
