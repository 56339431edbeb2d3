"""Entry of the launchers: `python -I bootstrap/__main__.py ARGUMENTS`, with any Python from 3.11 on."""

import sys
from pathlib import Path

if __name__ == "__main__":
    # Isolated mode (-I) keeps the user's folder and PYTHONPATH out, so the clone is put in by hand.
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    from bootstrap.run import main

    sys.exit(main(sys.argv[1:]))
