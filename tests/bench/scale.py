#!/usr/bin/env python3
"""What a panorama costs as a data set grows, and what the second night costs.

Renders one small street, lays copies of it out a kilometre apart, and builds maps of 100, 1000 and
10 000 panoramas (--sizes) from them, with the whole pipeline; then changes 1 % of the panoramas,
street by street, and builds again with the first night's vocabulary, signs the map and packs what
changed; and once more with the 1 % scattered, each in another street. Writes DIR/scale.md and
DIR/scale.json. Pictures are small, so that ten thousand take minutes: look at how cost grows, not
at what it is. Totals are processor time; columns of stages are their wall time. Python 3, standard
library only.
"""

import argparse
import copy
import json
import pathlib
import resource
import shutil
import subprocess
import tarfile

PER_STREET = 10


def run(command, log):
    """Processor seconds: what other work on the machine changes least."""
    with open(log, "w") as out:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([str(c) for c in command], stdout=out, stderr=out, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def city(street, num_streets):
    """Copies of a street on a square of places a kilometre apart."""
    features = []
    side = int(num_streets**0.5 + 0.999)
    for s in range(num_streets):
        for feature in copy.deepcopy(street["features"]):
            feature["id"] = f"s{s}-{feature['id']}"
            properties = feature["properties"]
            properties["links"] = [f"s{s}-{link}" for link in properties["links"]]
            point = feature["geometry"]["coordinates"]
            point[0] += 0.014 * (s % side)
            point[1] += 0.010 * (s // side)
            features.append(feature)
    return {**street, "features": features}


def stage_rows(report):
    return {s["name"]: s for s in report["stages"]}


def same_tiles(first, second):
    names = sorted(p.name for p in (first / "tiles").iterdir())
    same = sum((first / "tiles" / n).read_bytes() == (second / "tiles" / n).read_bytes()
               for n in names if (second / "tiles" / n).exists())
    return same, len(names)


def night(options, town, data, name, out, *more):
    path = town / f"{name}.geojson"
    path.write_text(json.dumps(data))
    seconds = run(
        [options.bin / "panofix-builder", "build", "--panoramas", path, "--camera",
         town / "camera.yaml", "--out", out / name, "--name", "city", "--work", out / "work",
         "--views", "4", "--station-spacing-m", "6", "--sift-words", "5000", "--mser-words", "1000",
         *more], out / f"{name}.log")
    report = json.loads((out / f"{name}.report.json").read_text())
    return seconds, report


def render(options, folder, seed):
    """One street, if it is not there yet."""
    if not (folder / "panoramas.geojson").exists():
        run([options.bin / "panofix-town", "--out", folder, "--seed", seed, "--panoramas",
             PER_STREET, "--no-drive", "--pano-width-px", "320", "--frame-width-px", "120",
             "--frame-height-px", "90"], options.out / "town.log")
    return json.loads((folder / "panoramas.geojson").read_text())


def changed(data, other, which):
    """The data set with some of its panoramas as they are in another street: pictures and depths
    that nothing in the old map has anything of."""
    data = copy.deepcopy(data)
    for i in which:
        for name in ("image", "depth"):
            path = other["features"][i % PER_STREET]["properties"][name]
            data["features"][i]["properties"][name] = f"other/{path}"
    return data


def shipped(options, town, first, second):
    """Bytes of the package from one night's bundle to the next, and which parts they are for."""
    key = town / "ship.key"
    if not key.exists():
        run([options.bin / "panofix-builder", "keygen", "--key", key, "--public",
             town / "ship.pub"], town / "ship.log")
    run([options.bin / "panofix-builder", "sign", second, "--key", key], town / "ship.log")
    package = second.with_suffix(".pfb")
    run([options.bin / "panofix-builder", "delta", first, second, "--out", package],
        town / "ship.log")
    kinds = {part["sha256"]: part["path"].split("/")[0]
             for part in json.loads((second / "manifest.json").read_text())["parts"]}
    parts = {}
    for entry in tarfile.open(package):
        target = entry.name.split("/")[-1].split(".")[0].split("-")[-1]
        kind = kinds.get(target, "manifest and the like")
        parts[kind] = parts.get(kind, 0) + entry.size
    bundle = sum(p.stat().st_size for p in second.rglob("*") if p.is_file())
    return {"package_bytes": package.stat().st_size, "bundle_bytes": bundle, "parts": parts}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=pathlib.Path, required=True, help="folder for all results")
    parser.add_argument("--bin", type=pathlib.Path, default=pathlib.Path("build/dev/bin"))
    parser.add_argument("--sizes", type=int, nargs="+", default=[100, 1000, 10000])
    options = parser.parse_args()
    options.bin = options.bin.resolve()
    options.out.mkdir(parents=True, exist_ok=True)
    town = options.out.resolve() / "town"
    street = render(options, town, 5)
    other = render(options, town / "other", 6)
    results = []
    for size in options.sizes:
        out = options.out.resolve() / str(size)
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir()
        data = city(street, size // PER_STREET)
        first_s, first = night(options, town, data, "first", out)
        num_changed = max(1, size // 100)
        together = changed(data, other, range(num_changed))
        scattered = changed(data, other, range(3, size, size // num_changed))
        release = ["--vocabulary", out / "first" / "vocabulary.h5"]
        quiet_s, _ = night(options, town, data, "quiet", out, *release, "--build", "2")
        second_s, second = night(options, town, together, "second", out, *release, "--build", "2")
        night(options, town, scattered, "scattered", out, *release, "--build", "2")
        same, tiles = same_tiles(out / "first", out / "second")
        ship = {name: shipped(options, town, out / "first", out / name)
                for name in ("quiet", "second", "scattered")}
        results.append({"panoramas": size, "first_s": first_s, "quiet_s": quiet_s,
                        "second_s": second_s, "same_tiles": same, "tiles": tiles,
                        "first": stage_rows(first), "second": stage_rows(second),
                        "ship": ship,
                        "scattered_same_tiles": same_tiles(out / "first", out / "scattered")[0],
                        "peak_mb": first["peak_memory_bytes"] / 1e6,
                        "bundle_mb": first["bundle_bytes"] / 1e6})
        shutil.rmtree(out / "work")
        (options.out / "scale.json").write_text(json.dumps(results, indent=1))
    names = [s for s in results[0]["first"] if s != "plan"]
    lines = ["| panoramas | cpu ms each | " + " | ".join(names) + " | peak MB | bundle MB |",
             "|---:|---:|" + "---:|" * (len(names) + 2)]
    for r in results:
        cells = [f"{1000 * r['first'][n]['duration_s'] / r['panoramas']:.2f}" for n in names]
        lines.append(f"| {r['panoramas']} | {1000 * r['first_s'] / r['panoramas']:.1f} | " +
                     " | ".join(cells) + f" | {r['peak_mb']:.0f} | {r['bundle_mb']:.1f} |")
    lines += ["", "| panoramas | first night, cpu s | without news | 1 % changed | "
              "tiles the same |", "|---:|---:|---:|---:|---:|"]
    for r in results:
        lines.append(f"| {r['panoramas']} | {r['first_s']:.1f} | {r['quiet_s']:.1f} | "
                     f"{r['second_s']:.1f} | {r['same_tiles']} of {r['tiles']} |")
    lines += ["", "| panoramas | without news, shipped | 1 % changed | 1 % scattered | tiles the same |",
              "|---:|---:|---:|---:|---:|"]
    for r in results:
        shares = [f"{100 * s['package_bytes'] / s['bundle_bytes']:.1f} %" for s in r["ship"].values()]
        lines.append(f"| {r['panoramas']} | " + " | ".join(shares) +
                     f" | {r['scattered_same_tiles']} of {r['tiles']} |")
    text = "\n".join(lines) + "\n"
    (options.out / "scale.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
