from .recompute import Verification as Verification
from .recompute import verify as verify
from .reruns import Rerun as Rerun
from .reruns import rerun as rerun
from .sameness import judge as judge
from .sameness import judge_runs as judge_runs
