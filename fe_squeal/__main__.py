"""python -m fe_squeal"""

import sys

from .cli import main

sys.exit(main())
