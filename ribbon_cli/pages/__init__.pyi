from . import columns as columns
from . import html as html
from . import run as run
from . import survey as survey
