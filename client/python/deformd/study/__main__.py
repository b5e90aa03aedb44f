# SPDX-License-Identifier: Apache-2.0
"""python -m deformd.study study.yaml"""

import argparse
import sys

from ..errors import Error
from .driver import OutsideConstraints, StudyStopped, run_study


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m deformd.study", description="Runs a study, or goes on with it where it was interrupted.")
    parser.add_argument("file", help="the study, in YAML (docs/studies.md)")
    parser.add_argument("--quiet", action="store_true", help="no progress")
    arguments = parser.parse_args()
    try:
        run_study(arguments.file, (lambda line: None) if arguments.quiet else (lambda line: print(line, flush=True)))
    except StudyStopped as error:
        print(f"stopped: {error}", file=sys.stderr)
        return 3
    except OutsideConstraints as error:
        print(error, file=sys.stderr)
        return 4
    except (Error, ImportError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted; the same command goes on with it", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
