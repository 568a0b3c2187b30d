"""The canvas of tools/drawings.py, with a style sheet for light and dark pages, shapes, texts, an eye and a scene."""

import math

WIDTH = 720
# The background is transparent, and a page may be dark when the reader's system is not. Each color therefore has a
# contrast of about 3:1 or more against white and against near-black, in both palettes.
LIGHT = {"ink": "#5c656f", "blue": "#1f6fc4", "orange": "#b8560f", "green": "#2a7d4f", "red": "#c2353f"}
DARK = {"ink": "#8c95a0", "blue": "#5498e2", "orange": "#cf8240", "green": "#49a172", "red": "#df6b72"}


def style():
    """Returns the style sheet. The class `f-COLOR` fills a shape, and `s-COLOR` strokes its outline."""

    def palette(colors):
        return "".join(f".f-{name}{{fill:{hue}}}.s-{name}{{stroke:{hue}}}" for name, hue in colors.items())

    font = "text{font-family:system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif;font-size:14px}"
    shapes = ".bold{font-weight:600}.soft{fill-opacity:.22}.none{fill:none}.dash{stroke-dasharray:5 4}"
    return f"{font}{shapes}{palette(LIGHT)}@media (prefers-color-scheme:dark){{{palette(DARK)}}}"


def number(value):
    # Adding zero turns a negative zero into zero.
    return f"{round(value, 1) + 0:.1f}".removesuffix(".0")


class Drawing:
    """One SVG file, drawn from back to front."""

    def __init__(self, name, height, title, description):
        self.name, self.parts = name, []
        self.head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height}" viewBox="0 0 {WIDTH} {height}" '
            f'role="img" aria-labelledby="title desc">\n<title id="title">{title}</title>\n<desc id="desc">{description}</desc>\n'
            f"<style>{style()}</style>\n"
        )

    def file(self):
        return self.head + "\n".join(self.parts) + "\n</svg>\n"

    def text(self, x, y, words, color="ink", anchor="middle", bold=False):
        """Each line of `words` is 18 pixels below the one before."""
        for row, line in enumerate(words.split("\n")):
            line = line.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
            weight = " bold" if bold else ""
            self.parts.append(f'<text class="f-{color}{weight}" x="{number(x)}" y="{number(y + 18 * row)}" '
                              f'text-anchor="{anchor}">{line}</text>')

    def path(self, points, color="ink", width=1.5, dashed=False):
        way = "M" + "L".join(f"{number(x)} {number(y)}" for x, y in points)
        self.parts.append(f'<path class="none s-{color}{" dash" if dashed else ""}" stroke-width="{width}" d="{way}"/>')

    def arrow(self, start, end, color="ink", width=1.5, both=False, dashed=False):
        self.path([start, end], color, width, dashed)
        for tip, tail in ((end, start), (start, end))[: 1 + both]:
            angle = math.atan2(tip[1] - tail[1], tip[0] - tail[0])
            wings = [(tip[0] - 8 * math.cos(angle + a), tip[1] - 8 * math.sin(angle + a)) for a in (0.4, -0.4)]
            self.polygon((tip, *wings), color)

    def shape(self, kind, sizes, color, fill, width, opacity=None, dashed=False):
        """A shape with an outline. `fill` is "none", "soft" or "full". `opacity` replaces the opacity of the fill."""
        names = {"none": "none", "soft": f"soft f-{color}", "full": f"f-{color}"}[fill] + f" s-{color}"
        own = "" if opacity is None else f' style="fill-opacity:{opacity:.2f}"'
        places = " ".join(f'{name}="{number(size)}"' for name, size in sizes.items())
        self.parts.append(f'<{kind} class="{names}{" dash" if dashed else ""}" stroke-width="{width}"{own} {places}/>')

    def rectangle(self, x, y, width, height, color="ink", fill="none", opacity=None, dashed=False, line=1.5):
        self.shape("rect", {"x": x, "y": y, "width": width, "height": height}, color, fill, line, opacity, dashed)

    def circle(self, x, y, radius, color="ink", fill="none", width=1.5, opacity=None):
        self.shape("circle", {"cx": x, "cy": y, "r": radius}, color, fill, width, opacity)

    def polygon(self, points, color, opacity=1.0):
        places = " ".join(f"{number(x)},{number(y)}" for x, y in points)
        self.parts.append(f'<polygon class="f-{color}" style="fill-opacity:{opacity:.2f}" points="{places}"/>')

    def bracket(self, x0, x1, y, color="ink", depth=6):
        """A bracket below y, open at the top."""
        self.path([(x0, y), (x0, y + depth), (x1, y + depth), (x1, y)], color)

    def lens(self, x, y, half):
        top, bottom, bulge = f"{number(x)} {number(y - half)}", f"{number(x)} {number(y + half)}", half / 9
        way = f"M{top}Q{number(x + bulge)} {number(y)} {bottom}Q{number(x - bulge)} {number(y)} {top}Z"
        self.parts.append(f'<path class="soft f-blue s-blue" stroke-width="1.5" d="{way}"/>')


def eye(out, pupil, half, depth, color="ink"):
    """Draws the ball and the iris of an eye whose pupil is at a point. `half` is the radius of the pupil.

    It returns a function from the slope of a ray through the center of the pupil to its place on the retina.
    """
    x, y = pupil
    radius = depth / 2
    opening = math.asin(half * 1.9 / radius)
    center = (x + radius * math.cos(opening), y)
    turn = [(center[0] - radius * math.cos(a), center[1] + radius * math.sin(a))
            for a in (opening + (2 * math.pi - 2 * opening) * i / 60 for i in range(61))]
    out.path(turn, color)
    for side in (-1, 1):
        out.path([(x, y + side * half), (x, y + side * half * 1.9)], color, 4)

    def retina(slope):
        # The ray is (x + t, y + slope t).
        gap = x - center[0]
        t = (-gap + math.sqrt(gap * gap - (1 + slope * slope) * (gap * gap - radius * radius))) / (1 + slope * slope)
        return x + t, y + slope * t

    return retina


def scene(out, x, y, size, circles, triangles):
    """Draws a picture of a circle at depth 0 and a triangle in front of it.

    Each list has the copies of one of them, as (shift x, shift y, opacity).
    """
    out.rectangle(x, y, size, size)
    r = size * 0.13
    for dx, dy, opacity in circles:
        out.circle(x + size * 0.35 + dx, y + size * 0.36 + dy, r, "green", "full", 0, opacity)
    for dx, dy, opacity in triangles:
        tx, ty = x + size * 0.6 + dx, y + size * 0.7 + dy
        out.polygon(((tx, ty - r), (tx + r, ty + r), (tx - r, ty + r)), "orange", opacity)
