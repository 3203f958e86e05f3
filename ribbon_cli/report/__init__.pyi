from . import comparison as comparison
from . import continuum as continuum
from . import convergence as convergence
from . import rows as rows
from . import spectra as spectra
from . import tables as tables
