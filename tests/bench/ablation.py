#!/usr/bin/env python3
"""What each step from the published method to panofix's default is worth.

Renders towns, builds the map bundles, localizes each town's drive row by row, scores the answers
against the exact truth, and writes DIR/ablation.md with two plots. What an earlier run left in DIR
is used again while the programs and arguments are the same. Python 3, standard library only.
"""

import argparse
import hashlib
import json
import pathlib
import statistics
import subprocess
import sys
import time

sys.dont_write_bytecode = True  # the source tree stays as it is
import figures  # noqa: E402

TOWNS = {  # name: arguments of panofix-town
    "ahead": ["--seed", "21"],
    "oblique": ["--seed", "22", "--camera-yaw-deg", "-45"],
    "look_alikes": ["--seed", "23", "--look-alikes", "--off-map-frames", "6"],
}

CLAHE = ["--preset", "paper", "--equalization", "clahe"]
ROOT = CLAHE + ["--root-sift"]
STATIONS = ROOT + ["--no-view-images", "--station-spacing-m", "2.5"]
MERGED = STATIONS + ["--merge"]
REFINED = MERGED + ["--refine"]
BUNDLES = {  # name: arguments of panofix-builder build; each town's share one work folder
    "paper": ["--preset", "paper"],
    "clahe": CLAHE,
    "root": ROOT,
    "stations": STATIONS,
    "merged": MERGED,
    "refined": REFINED,
    "default": [],
}

LEVERS = ["mutual", "ranked", "pooled", "sigmas", "gates", "votes"]


def levers(count, *more):
    return ["--preset", "paper", "--add", ",".join(LEVERS[:count] + list(more))]


PAPER_ROW, DEFAULT_ROW = "paper", "+ finds confirmed (default)"
ROWS = [  # label, bundle, arguments of panofix-runtime localize: one lever a row
    (PAPER_ROW, "paper", ["--preset", "paper"]),
    ("+ CLAHE", "clahe", ["--preset", "paper"]),
    ("+ RootSIFT", "root", ["--preset", "paper"]),
    ("+ mutual (no kVLD)", "root", levers(1)),
    ("+ ranked", "root", levers(2)),
    ("+ pooled", "root", levers(3)),
    ("+ sigmas", "root", levers(4)),
    ("+ gates", "root", levers(5)),
    ("+ votes", "root", levers(6)),
    ("+ rendered views", "stations", levers(6)),
    ("+ merged landmarks", "merged", levers(6)),
    ("+ joint refinement", "refined", levers(6)),
    ("+ pruned and packed", "default", levers(6)),
    ("+ guided", "default", levers(6, "guided")),
    ("+ tracking", "default", levers(6, "guided", "tracking")),
    ("+ bridging", "default", levers(6, "guided", "tracking", "bridging")),
    ("+ half size first", "default", levers(6, "guided", "tracking", "bridging", "coarse")),
    (DEFAULT_ROW, "default", []),
    ("paper, whole map each frame", "paper", ["--preset", "paper", "--add", "exhaustive"]),
    ("default, whole map each frame", "default", ["--add", "exhaustive"]),
]


def run(command, log):
    log.parent.mkdir(parents=True, exist_ok=True)
    with open(log, "w", encoding="utf-8") as out:
        if subprocess.run(command, stdout=out, stderr=subprocess.STDOUT, check=False).returncode:
            tail = log.read_text(encoding="utf-8")[-600:]
            sys.exit(f"ablation.py: {' '.join(map(str, command))} failed:\n{tail}")


def once(stamp_file, command, log):
    """Runs a command unless it ran before with the same arguments and program."""
    program = hashlib.sha256(pathlib.Path(command[0]).read_bytes()).hexdigest()
    stamp = " ".join(map(str, command)) + "\n" + program + "\n"
    if stamp_file.exists() and stamp_file.read_text(encoding="utf-8") == stamp:
        return
    start = time.monotonic()
    run(command, log)
    stamp_file.write_text(stamp, encoding="utf-8")
    print(f"{stamp_file.with_suffix('').name:40} {time.monotonic() - start:7.1f} s", flush=True)


class Bench:
    def __init__(self, args):
        self.out, self.args = args.out, args

    def program(self, name):
        path = self.args.bin / name
        return path if path.exists() else sys.exit(f"ablation.py: {path} is not there; build it")

    def town(self, town):
        folder = self.out / "towns" / town
        once(folder.with_suffix(".stamp"),
             [self.program("panofix-town"), "--out", folder, "--panoramas", self.args.panoramas,
              "--frames", self.args.frames] + TOWNS[town], folder.with_suffix(".log"))
        return folder

    def bundle(self, town, name):
        folder = self.out / "bundles" / f"{town}.{name}"
        data = self.town(town)
        once(folder.with_suffix(f".{name}.stamp"),
             [self.program("panofix-builder"), "build", "--panoramas", data / "panoramas.geojson",
              "--camera", data / "camera.yaml", "--out", folder,
              "--work", self.out / "bundles" / f"{town}.work"] + BUNDLES[name],
             folder.with_suffix(f".{name}.log"))
        return folder

    def row(self, town, number, bundle_name, arguments):
        """Frames of one town in one row: their scores, rows of poses.csv and log entries."""
        bundle, drive = self.bundle(town, bundle_name), self.town(town) / "drive"
        base = self.out / "poses" / f"{town}.{number:02}"
        poses = base.with_suffix(f".{number:02}.csv")
        log = base.with_suffix(f".{number:02}.log.json")
        once(base.with_suffix(f".{number:02}.stamp"),
             [self.program("panofix-runtime"), "localize", "--bundle", bundle, "--drive", drive,
              "--out", poses, "--log", log] + arguments, base.with_suffix(f".{number:02}.log"))
        score = base.with_suffix(f".{number:02}.score.json")
        run([self.program("panofix-builder"), "score", "--poses", poses, "--drive", drive,
             "--bundle", bundle, "--log", log, "--json", score],
            base.with_suffix(f".{number:02}.score.log"))
        return figures.Run(self.town(town), poses, json.loads(log.read_text()),
                           json.loads(score.read_text()))


def summarize(runs):
    """One row over all towns' frames."""
    frames = [frame for run_ in runs for frame in run_.score["frames"]]
    fixes = [frame for frame in frames if frame["status"] == "fix"]
    errors = [frame["position_error_m"] for frame in fixes]
    nees = [frame["nees"] for frame in fixes if "nees" in frame]
    logged = [frame for run_ in runs for frame in run_.log["frames"]]

    compared = sum(frame["num_compared"] for frame in logged)
    database = sum(frame["num_database"] for frame in logged)
    times_features = [f["total_ms"] / f["features_ms"] for f in logged if f["features_ms"] > 0]

    def within(band):
        return sum(run_.score["share_within"][band]["share"] * run_.score["num_frames"]
                   for run_ in runs) / len(frames)

    return {
        "fix %": f"{100 * len(fixes) / len(frames):.1f}",
        "0.25 m %": f"{100 * within(0):.1f}",
        "1 m %": f"{100 * within(2):.1f}",
        "false fixes": str(sum(error > 5 for error in errors)),
        "median m": f"{statistics.median(errors):.3f}" if errors else "-",
        "NEES": f"{statistics.median(nees):.1f}" if nees else "-",
        "p50 ms": f"{statistics.median(frame['total_ms'] for frame in logged):.0f}",
        # The load of the machine cancels out of this one.
        "of features": f"{statistics.median(times_features):.2f}",
        "MB/km": f"{statistics.mean(run_.score['bundle_mb_per_km'] for run_ in runs):.1f}",
        "avoided %": f"{100 - 100 * compared / max(1, database):.1f}",
    }


def table(results):
    columns = list(next(iter(results.values())))
    lines = ["| | " + " | ".join(columns) + " |", "|---|" + "---:|" * len(columns)]
    for label, values in results.items():
        lines.append(f"| {label} | " + " | ".join(values.values()) + " |")
    return "\n".join(lines) + "\n"


def keep_in_readme(here, out, text):
    """Puts the table between the marks of README.md, and the plots beside it."""
    readme = here / "README.md"
    begin, end = "<!-- ablation -->\n", "<!-- end -->\n"
    before, _, rest = readme.read_text(encoding="utf-8").partition(begin)
    _, _, after = rest.partition(end)
    readme.write_text(before + begin + text + end + after, encoding="utf-8")
    for name in ("error_by_inliers.svg", "error_by_distance.svg"):
        (here / name).write_bytes((out / name).read_bytes())


def main():
    here = pathlib.Path(__file__).resolve().parent
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=pathlib.Path, required=True, help="folder of all results")
    parser.add_argument("--bin", type=pathlib.Path, default=here.parents[1] / "build/dev/bin",
                        help="the programs (default: build/dev/bin)")
    parser.add_argument("--towns", default=",".join(TOWNS), help="of " + ", ".join(TOWNS))
    parser.add_argument("--panoramas", default="12", help="a town (default 12)")
    parser.add_argument("--frames", default="24", help="a town (default 24)")
    parser.add_argument("--only", choices=BUNDLES, metavar="BUNDLE",
                        help="measure the rows on one bundle (" + ", ".join(BUNDLES) +
                        "); the others stay as an earlier run in OUT left them, the plots too")
    parser.add_argument("--readme", action="store_true",
                        help="also put table and plots into tests/bench")
    args = parser.parse_args()
    towns = args.towns.split(",")
    for town in towns:
        if town not in TOWNS:
            parser.error(f"--towns {town}: there are {', '.join(TOWNS)}")
    bench = Bench(args)
    for folder in ("towns", "bundles", "poses"):
        (args.out / folder).mkdir(parents=True, exist_ok=True)
    results, runs_of = {}, {}
    earlier = args.out / "ablation.json"
    if args.only and not earlier.exists():
        parser.error(f"--only: {earlier} is not there; run without it first")
    before = json.loads(earlier.read_text(encoding="utf-8")) if args.only else {}
    for number, (label, bundle, arguments) in enumerate(ROWS):
        if args.only not in (None, bundle):
            if list(before.get(label, {}))[-len(towns):] != towns:
                sys.exit(f"ablation.py: --only: {earlier} has no row '{label}' of these towns; "
                         "run without it first")
            results[label] = before[label]
            continue
        runs_of[label] = [bench.row(town, number, bundle, arguments) for town in towns]
        results[label] = summarize(runs_of[label])
        for town, run_ in zip(towns, runs_of[label]):
            score = run_.score
            results[label][town] = f"{100 * score['share_fix']:.0f} % / {score['num_false_fixes']}"
    (args.out / "ablation.md").write_text(table(results), encoding="utf-8")
    (args.out / "ablation.json").write_text(json.dumps(results, indent=1), encoding="utf-8")
    if not args.only:
        figures.write(args.out, {"paper": runs_of[PAPER_ROW], "default": runs_of[DEFAULT_ROW]})
    print(table(results), end="")
    if args.readme:
        keep_in_readme(here, args.out, table(results))


if __name__ == "__main__":
    main()
