"""Bad recordings and bad options by the hundred, and a recording of ten million rows.

    python benchmarks/bad_input.py                 600 options and recordings, 10 million rows (1.4 GB, 15 minutes)
    python benchmarks/bad_input.py --rows 1000000

Writes benchmarks/results/bad_input.txt.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "data"))


def generated(options: int) -> str:
    """Run the generated and the kept cases; one line that counts them."""
    environment = {**os.environ, "FRICTIONPINN_EXAMPLES": str(options)}
    command = [sys.executable, "-m", "pytest", "-q", "-k", "one_line", str(ROOT / "tests/workflow/test_bad_input.py")]
    begin = time.perf_counter()
    told = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    from nasty import KEPT

    verdict = "no traceback, none above 10 s of processor time" if told.returncode == 0 else told.stdout[-2000:]
    seconds = time.perf_counter() - begin
    return f"{5 * options} recordings and {options} options generated, {len(KEPT)} kept: {verdict} ({seconds:.0f} s)"


def write_rows(path: Path, rows: int) -> None:
    """Write a recording of that many rows in three trials, a piece at a time."""
    from nasty import swing

    piece = swing(100_000, 1)
    with path.open("w") as file:
        file.write(",".join(piece.columns) + "\n")
        for first in range(0, rows, 100_000):
            count = min(100_000, rows - first)
            part = piece[:count].assign(trial=1 + 3 * first // rows, t=np.arange(first, first + count) * 1e-3)
            part.to_csv(file, index=False, header=False)


def scale(rows: int) -> list[str]:
    """Read a long recording, then train on it: memory and time, and how the training ends."""
    from test_bad_input import MEASURE  # the program that the test runs too

    lines = []
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "long.csv"
        write_rows(path, rows)
        size = path.stat().st_size
        told = subprocess.run([sys.executable, "-c", MEASURE, path], capture_output=True, text=True, check=True).stdout
        read, trials, memory, seconds = (float(item) for item in told.split())
        lines.append(
            f"{read:.0f} rows, {trials:.0f} trials, {size / 1e9:.2f} GB: read in {seconds:.0f} s "
            f"with {memory / 1e9:.2f} GB, {memory / size:.2f} times the file"
        )
        train = [sys.executable, str(ROOT / "train.py"), "model=bb1", "data=csv", "data.path=long.csv"]
        train += ["trainer.max_epochs=3", "trainer.accelerator=cpu", "trainer.threads=1"]
        for further in ([], ["data.rate_hz=50", "smoothing=savgol"]):
            begin = time.perf_counter()
            process = subprocess.Popen(
                [*train, *further], cwd=name, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
            )
            last = process.stdout.read().strip().splitlines()[-1]  # type: ignore[union-attr]
            _, _, usage = os.wait4(process.pid, 0)
            told = re.sub(r"in \S*/?outputs/\S+", "in outputs/...", last).replace(name, "")
            lines.append(
                f"train {' '.join(further) or 'as it is'}: {told} "
                f"[{time.perf_counter() - begin:.0f} s, {usage.ru_maxrss * 1024 / size:.2f} times the file]"
            )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--options", type=int, default=100)
    parser.add_argument("--rows", type=int, default=10_000_000)
    arguments = parser.parse_args()
    sys.path.insert(0, str(ROOT / "tests" / "workflow"))
    text = "\n".join([generated(arguments.options), *scale(arguments.rows)]) + "\n"
    (ROOT / "benchmarks" / "results" / "bad_input.txt").write_text(text)
    print(text, end="")
    print(f"peak of this process: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB", file=sys.stderr)


if __name__ == "__main__":
    main()
