"""
The fuzz tests: 10,000 examples by default, always the same ones.

``TP_FUZZ=1000000 python -m pytest test/faults/test_fuzz.py`` tries a million others.
"""

import os

from hypothesis import HealthCheck, Phase, settings

DEFAULT = 10_000
EXAMPLES = int(os.environ.get('TP_FUZZ', DEFAULT))

settings.register_profile(
    'faults', derandomize=EXAMPLES == DEFAULT, deadline=None, database=None,
    max_examples=EXAMPLES // 11, phases=[Phase.explicit, Phase.generate, Phase.shrink],
    suppress_health_check=list(HealthCheck))
settings.load_profile('faults')
