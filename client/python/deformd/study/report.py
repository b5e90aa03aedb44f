# SPDX-License-Identifier: Apache-2.0
"""The HTML report of a study, one file without anything from elsewhere."""

import base64
import html
import struct
import zlib
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np

from ..errors import Error
from .spec import Spec
from .worker import Task, points_of, quality_of, rest_and_faces

Record = Dict[str, Any]
_STYLE = "body{font:15px sans-serif;max-width:70em;margin:2em auto;color:#222}table{border-collapse:collapse}td,th{padding:.2em .8em;text-align:right;" \
         "border-bottom:1px solid #ddd}svg{background:#fafafa;width:100%}figure{display:inline-block;width:47%;margin:1%}img{width:100%}"
_WIDTH, _HEIGHT = 900.0, 300.0


def page(spec: Spec, names: Sequence[str], bounds: np.ndarray, task: Task, records: List[Record], best: Optional[Record], front: List[Record],
         ends: Sequence[str]) -> str:
    """The page: counts, the history, the Pareto front of several objectives, all designs as parallel coordinates, the best beside the original with its quality, failures."""
    counts = {verdict: sum(each["verdict"] == verdict for each in records) for verdict in ("good", "doubtful", "unknown", "bad", "failed")}
    parts = [f"<h1>{html.escape(spec.folder.name)}</h1><p>{len(records)} designs: " +
             ", ".join(f"{count} {verdict}" for verdict, count in counts.items() if count) + ".</p>"]
    parts += [f"<p>{html.escape(line[:1].upper() + line[1:])}.</p>" for line in ends]
    if spec.objectives:
        parts.append(_history(spec, records))
    if front:
        parts.append(_front(spec, names, records, front))
    parts.append(_parallel(spec, names, bounds, records, best))
    if best is not None:
        parts.append(_best(names, task, best, f" in {spec.objectives[0][0]}" if front else ""))
    lost = [each for each in records if each["verdict"] in ("bad", "failed")]
    if lost:
        parts.append("<h2>Designs that failed</h2><table><tr><th>design<th>verdict<th>reasons</tr>" + "".join(
            f"<tr><td>{each['number']}<td>{each['verdict']}<td style='text-align:left'>{html.escape('; '.join(each['reasons']))}</tr>" for each in lost) + "</table>")
    return f"<!doctype html><html lang='en'><meta charset='utf-8'><title>{html.escape(spec.folder.name)}</title><style>{_STYLE}</style>{''.join(parts)}</html>\n"


def _history(spec: Spec, records: List[Record]) -> str:
    from .driver import TOLERANCE, failed, violations

    found = []
    for name, sign in spec.objectives:
        wanted = {name, *(each for each, _, _ in spec.constraints)}
        known = [(each["number"], each["values"][name], all(v <= TOLERANCE for v in violations(spec, each)))
                 for each in records if not failed(each) and wanted <= each["values"].keys()]
        if not known:
            continue
        low, high = min(value for _, value, _ in known), max(value for _, value, _ in known)
        last = max(1, records[-1]["number"])

        def place(number: float, value: float) -> Tuple[float, float]:
            return 30 + number / last * (_WIDTH - 60), _HEIGHT - 20 - (value - low) / ((high - low) or 1) * (_HEIGHT - 40)

        dots, line, best = [], [], None
        for number, value, feasible in known:
            x, y = place(number, value)
            dots.append(f"<circle cx='{x:.1f}' cy='{y:.1f}' r='3' fill='{'#47a' if feasible else '#ccc'}'><title>design {number}: {value:.6g}</title></circle>")
            if feasible and (best is None or sign * value < sign * best):
                best = value
            if best is not None:
                line.append("%.1f,%.1f" % place(number, best))
        found.append(f"<h2>{html.escape(name)}</h2><p>From {low:.6g} to {high:.6g}; the line is the best so far"
                     f"{'' if best is None else f', {best:.6g} at the end'}; grey is outside of the constraints.</p><svg viewBox='0 0 {_WIDTH:.0f} {_HEIGHT:.0f}'>"
                     f"{''.join(dots)}<polyline points='{' '.join(line)}' fill='none' stroke='#c33' stroke-width='2'/></svg>")
    return "".join(found)


def _front(spec: Spec, names: Sequence[str], records: List[Record], front: List[Record]) -> str:
    """A picture of each further objective over the first: all designs that have both, the front above them; and the front as a table."""
    goals = [name for name, _ in spec.objectives]
    numbers = {each["number"] for each in front}
    measured = sorted((each for each in records if each["verdict"] not in ("bad", "failed") and set(goals) <= each["values"].keys()),
                      key=lambda each: each["number"] in numbers)
    ranges = {name: (min(each["values"][name] for each in measured), max(each["values"][name] for each in measured)) for name in goals}

    def part(each: Record, name: str) -> float:
        low, high = ranges[name]
        return (each["values"][name] - low) / ((high - low) or 1)

    pictures = []
    for other in goals[1:]:
        dots = "".join(f"<circle cx='{60 + part(each, goals[0]) * (_WIDTH - 120):.1f}' cy='{_HEIGHT - 40 - part(each, other) * (_HEIGHT - 60):.1f}' r='3.5' "
                       f"fill='{'#c33' if each['number'] in numbers else '#bbb'}'><title>design {each['number']}: {each['values'][goals[0]]:.6g}, "
                       f"{each['values'][other]:.6g}</title></circle>" for each in measured)
        low, high = ranges[other]
        left, right = ranges[goals[0]]
        pictures.append(f"<svg viewBox='0 0 {_WIDTH:.0f} {_HEIGHT:.0f}' font-size='12'>{dots}<text x='8' y='14'>{html.escape(other)} {high:.4g}</text>"
                        f"<text x='8' y='{_HEIGHT - 26:.0f}'>{low:.4g}</text><text x='60' y='{_HEIGHT - 8:.0f}'>{html.escape(goals[0])} {left:.4g}</text>"
                        f"<text x='{_WIDTH - 60:.0f}' y='{_HEIGHT - 8:.0f}' text-anchor='end'>{right:.4g}</text></svg>")
    others = sorted({name for each in front for name in each["values"]} - set(goals))
    head = "".join(f"<th>{html.escape(name)}" for name in ["design", *goals, *others, *names])
    rows = "".join(f"<tr><td>{each['number']}" + "".join(f"<td>{each['values'][name]:.6g}" if name in each["values"] else "<td>" for name in [*goals, *others]) +
                   "".join(f"<td>{value:.6g}" for value in each["x"]) + "</tr>" for each in front)
    return (f"<h2>The Pareto front</h2><p>{len(front)} designs, in red: none is better in one objective without being worse in another.</p>"
            f"{''.join(pictures)}<div style='overflow-x:auto'><table><tr>{head}</tr>{rows}</table></div>")


def _parallel(spec: Spec, names: Sequence[str], bounds: np.ndarray, records: List[Record], best: Optional[Record]) -> str:
    measured = sorted({name for each in records for name in each["values"]})
    axes: List[Tuple[str, float, float]] = []
    for i, name in enumerate(names):
        column = [each["x"][i] for each in records] or [0.0]
        axes.append((name, *((float(v) for v in bounds[i]) if np.isfinite(bounds[i]).all() else (min(column), max(column)))))
    for name in measured:
        column = [each["values"][name] for each in records if name in each["values"]]
        axes.append((name, min(column), max(column)))
    step = (_WIDTH - 120) / max(1, len(axes) - 1)
    lines = []
    for each in sorted(records, key=lambda each: each is best):
        values = [*each["x"], *[each["values"].get(name) for name in measured]]
        places = " ".join(f"{60 + i * step:.1f},{_HEIGHT - 40 - (value - low) / ((high - low) or 1) * (_HEIGHT - 80):.1f}"
                          for i, (value, (_, low, high)) in enumerate(zip(values, axes)) if value is not None)
        colour = "#c33" if each is best else "#bbb" if each["verdict"] in ("bad", "failed") else "#47a"
        lines.append(f"<polyline points='{places}' fill='none' stroke='{colour}' stroke-opacity='{1 if each is best else .35}'/>")
    marks = "".join(f"<line x1='{60 + i * step:.1f}' x2='{60 + i * step:.1f}' y1='40' y2='{_HEIGHT - 40}' stroke='#333'/><g font-size='12' text-anchor='middle'>"
                    f"<text x='{60 + i * step:.1f}' y='16'>{html.escape(name)}</text><text x='{60 + i * step:.1f}' y='34'>{high:.4g}</text>"
                    f"<text x='{60 + i * step:.1f}' y='{_HEIGHT - 22}'>{low:.4g}</text></g>" for i, (name, low, high) in enumerate(axes))
    legend = ", ".join(["Red is the best one"] * (best is not None) + ["grey failed"] * any(each["verdict"] in ("bad", "failed") for each in records))
    legend = f"<p>{legend[:1].upper()}{legend[1:]}.</p>" if legend else ""
    return f"<h2>All designs</h2>{legend}<svg viewBox='0 0 {_WIDTH:.0f} {_HEIGHT:.0f}'>{''.join(lines)}{marks}</svg>"


def _best(names: Sequence[str], task: Task, best: Record, where: str) -> str:
    rows = "".join(f"<tr><td>{html.escape(name)}<td>{value:.6g}</tr>" for name, value in [*zip(names, best["x"]), *best["values"].items()])
    text = f"<h2>The best{html.escape(where)}, design {best['number']}</h2><table>{rows}<tr><td>verdict<td>{best['verdict']}</tr></table>"
    try:
        rest, faces = rest_and_faces(task)
        moved = points_of({**task, "x": best["x"]})
    except Error as error:
        return text + f"<p>No pictures: {html.escape(str(error))}</p>"
    low, high = np.minimum(rest, moved).min(axis=0), np.maximum(rest, moved).max(axis=0)
    pictures = "".join(f"<figure><img alt='{title}' src='data:image/png;base64,{base64.b64encode(_picture(points, faces, low, high)).decode()}'>"
                       f"<figcaption>{title}</figcaption></figure>" for title, points in (("original", rest), ("best", moved)))
    before, after = (quality_of(task).rows(points) for points in (rest, moved))
    known = {row.name: row.value for row in before}
    quality = "".join(f"<tr><td style='text-align:left'>{html.escape(row.label)}<td>{known[row.name]:.6g}<td>{row.value:.6g}</tr>"
                      for row in after if row.in_table and row.name in known)
    return text + pictures + f"<table><tr><th style='text-align:left'>quality<th>original<th>best</tr>{quality}</table>"


def _picture(points: np.ndarray, faces: np.ndarray, low: np.ndarray, high: np.ndarray, width: int = 640) -> bytes:
    """A PNG of the faces, seen from the front, the left and above; samples of faces into a buffer of depths."""
    centre, size = (low + high) / 2, float(np.linalg.norm(high - low)) or 1.0
    towards = np.array([-0.55, -0.7, 0.45]) / np.linalg.norm([-0.55, -0.7, 0.45])
    right = np.cross([0, 0, 1], towards)
    right /= np.linalg.norm(right)
    frame = np.stack([right, np.cross(towards, right), towards])
    height = int(width * 0.6)
    seen = (points - centre) @ frame.T * (width * 0.9 / size)
    a, b, c = (seen[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    shades = (70 + 170 * np.abs(normals[:, 2]) / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)).astype(np.uint8)
    lengths = np.sqrt(np.maximum.reduce([((p - q)[:, :2] ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))]))
    counts = np.clip(np.ceil(lengths * 1.5), 1, width).astype(int)
    image, depths = np.full(height * width, 255, np.uint8), np.full(height * width, -np.inf)
    for n in 2 ** np.arange(11):  # faces of a like size at a time
        chosen = (counts <= n) & (counts > n // 2)
        if not chosen.any():
            continue
        u, v = (grid.ravel() / n for grid in np.meshgrid(np.arange(n + 1), np.arange(n + 1)))
        u, v = u[u + v <= 1 + 1e-9], v[u + v <= 1 + 1e-9]
        for some in np.array_split(np.flatnonzero(chosen), max(1, chosen.sum() * len(u) // 2_000_000)):
            at = (a[some, None] * (1 - u - v)[:, None] + b[some, None] * u[:, None] + c[some, None] * v[:, None]).reshape(-1, 3)
            column, row = (at[:, 0] + width / 2).astype(int), (height / 2 - at[:, 1]).astype(int)
            inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
            pixel, depth, shade = (row * width + column)[inside], at[inside, 2], np.repeat(shades[some], len(u))[inside]
            order = np.argsort(depth, kind="stable")
            pixel, depth, shade = pixel[order], depth[order], shade[order]
            nearer = depth > depths[pixel]
            image[pixel[nearer]], depths[pixel[nearer]] = shade[nearer], depth[nearer]
    rows = b"".join(b"\0" + line.tobytes() for line in image.reshape(height, width))

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
