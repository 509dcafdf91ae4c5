"""python -m fe_squeal"""

import sys

from fe_squeal_start import main

if __name__ == "__main__":
    sys.exit(main())
