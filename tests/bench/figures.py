"""Scatter plots of the ablation as SVG, written by hand: no libraries."""

import csv
import json
import math

WIDTH, HEIGHT, LEFT, BOTTOM, TOP, RIGHT = 640, 400, 64, 48, 28, 16
COLOURS = {"paper": "#c0392b", "default": "#1f5fa8"}
METRES_PER_DEG = 111_320


class Run:
    """One town localized once: answers, truth and the map's panoramas."""

    def __init__(self, town, poses, log, score):
        self.town, self.log, self.score = town, log, score
        with open(poses, encoding="utf-8") as file:
            self.rows = {int(row["timestamp_ns"]): row for row in csv.DictReader(file)}

    def fixes(self):
        """(inliers, metres from the truth to the nearest panorama, error in metres) of each fix."""
        with open(self.town / "drive" / "truth.csv", encoding="utf-8") as file:
            truth = {int(row["timestamp_ns"]): row for row in csv.DictReader(file)}
        features = json.loads((self.town / "panoramas.geojson").read_text())["features"]
        panoramas = [feature["geometry"]["coordinates"] for feature in features]
        for frame in self.score["frames"]:
            if frame["status"] != "fix" or "position_error_m" not in frame:
                continue
            at = truth[frame["timestamp_ns"]]
            latitude, longitude = float(at["latitude"]), float(at["longitude"])
            nearest_m = min(
                METRES_PER_DEG * math.hypot((lon - longitude) * math.cos(math.radians(latitude)),
                                            lat - latitude) for lon, lat, *_ in panoramas)
            inliers = int(self.rows[frame["timestamp_ns"]]["num_inliers"])
            yield inliers, nearest_m, frame["position_error_m"]


class Axis:
    """Data to pixels; logarithmic axes are labelled at 1, 2 and 5 of each decade."""

    def __init__(self, values, first_px, last_px, log):
        self.log, self.first_px, self.last_px = log, first_px, last_px
        low, high = min(values), max(values)
        self.low = math.log10(low) - 0.05 if log else 0.0
        self.high = math.log10(high) + 0.05 if log else high * 1.05
        if self.high <= self.low:
            self.high = self.low + 1

    def px(self, value):
        position = math.log10(value) if self.log else value
        share = (position - self.low) / (self.high - self.low)
        return self.first_px + share * (self.last_px - self.first_px)

    def ticks(self):
        if not self.log:
            step = next(s for s in (1, 2, 5, 10, 20, 50, 100) if self.high / s <= 8)
            return [step * i for i in range(int(self.high / step) + 1)]
        decades = range(math.floor(self.low), math.ceil(self.high) + 1)
        ticks = [digit * 10.0**decade for decade in decades for digit in (1, 2, 5)]
        return [tick for tick in ticks if self.low <= math.log10(tick) <= self.high]


def scatter(points, x_title, log_x):
    """SVG of {name: [(x, error_m)]}; the dashed line is where a fix becomes a false one."""
    everything = [point for series in points.values() for point in series] or [(1, 1)]
    x = Axis([max(p[0], 1e-3) for p in everything], LEFT, WIDTH - RIGHT, log_x)
    y = Axis([max(p[1], 1e-3) for p in everything] + [6.0], HEIGHT - BOTTOM, TOP, True)
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}" '
             f'viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" font-size="12">',
             f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>']
    for tick in x.ticks():
        parts.append(f'<path d="M{x.px(tick):.1f} {TOP}V{HEIGHT - BOTTOM}" stroke="#ddd"/>'
                     f'<text x="{x.px(tick):.1f}" y="{HEIGHT - BOTTOM + 16}" '
                     f'text-anchor="middle">{tick:g}</text>')
    for tick in y.ticks():
        parts.append(f'<path d="M{LEFT} {y.px(tick):.1f}H{WIDTH - RIGHT}" stroke="#ddd"/>'
                     f'<text x="{LEFT - 6}" y="{y.px(tick) + 4:.1f}" '
                     f'text-anchor="end">{tick:g}</text>')
    parts.append(f'<path d="M{LEFT} {y.px(5):.1f}H{WIDTH - RIGHT}" stroke="#555" '
                 'stroke-dasharray="6 4"/>')
    for number, (name, series) in enumerate(points.items()):
        colour = COLOURS[name]
        for px, error_m in series:
            parts.append(f'<circle cx="{x.px(max(px, 1e-3)):.1f}" '
                         f'cy="{y.px(max(error_m, 1e-3)):.1f}" r="3" fill="{colour}" '
                         'fill-opacity="0.6"/>')
        left = LEFT + 8 + 150 * number
        parts.append(f'<circle cx="{left}" cy="{TOP - 12}" r="4" fill="{colour}"/>'
                     f'<text x="{left + 8}" y="{TOP - 8}">{name}: {len(series)} fixes</text>')
    parts.append(f'<text x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 10}" '
                 f'text-anchor="middle">{x_title}</text>'
                 f'<text transform="translate(16 {HEIGHT / 2}) rotate(-90)" '
                 'text-anchor="middle">position error of a fix, m</text></svg>')
    return "\n".join(parts) + "\n"


def write(folder, runs_of):
    """error_by_inliers.svg and error_by_distance.svg of {name: runs}."""
    fixes = {name: [fix for run in runs for fix in run.fixes()] for name, runs in runs_of.items()}
    for name, column, title, log_x in (
            ("error_by_inliers", 0, "inliers", True),
            ("error_by_distance", 1, "distance to the nearest panorama, m", False)):
        points = {key: [(fix[column], fix[2]) for fix in series] for key, series in fixes.items()}
        (folder / f"{name}.svg").write_text(scatter(points, title, log_x), encoding="utf-8")
