from . import text as text
from .reading import Equilibrium as Equilibrium
from .reading import Findings as Findings
from .reading import findings as findings
from .reading import is_survey as is_survey
from .run import Request as Request
from .run import survey_config as survey_config
