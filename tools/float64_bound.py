#!/usr/bin/env python3
"""Searches for the best hologram on a display with faults, with a long descent in float64 to compare solves with.

    python3 tools/float64_bound.py --display bench.toml --views views/ --seconds 600 -o out.npy                from random phases
    python3 tools/float64_bound.py --display bench.toml --views views/ --seconds 600 -o out.npy --start eyebox.npy
    python3 tools/float64_bound.py --display bench.toml --views views/ --judge eyebox.npy [--pupils scores.json]
    python3 tools/float64_bound.py --check ORACLE_FOLDER                     against oracle.py, and the gradient against differences

The search minimizes the negative of the measure of `eyebox eval score`. This measure is the mean PSNR over pupils, each
after averaging 2 x 2 pixels, at one exposure for all of them, which is optimized too. Pupils come from a fixed set of
the distribution of the score (diameters even between 2 and 20 mm). The pupils of the final score have another seed. Adam
moves the phases, with a rate that falls as a cosine and with more and more pupils per step. All numbers are float64. The
model is the one of OPTICS 10 with one sample per pixel, which is the default of eyebox. The result is no proof of a
bound. It is the best that a long search of another kind finds.

The folder --views has the views of the scene, 0.npy to 80.npy, row by row. `eyebox render` makes them through 1 mm in
the middle of each cell. The script needs NumPy and Python 3.11. If SciPy is installed, it uses SciPy's transforms, which
are twice as fast.
"""
import argparse, json, math, pathlib, sys, time, tomllib
import numpy as np

try:
    from scipy.fft import fft, ifft
except ImportError:
    from numpy.fft import fft, ifft

TAU, PITCH, FOCAL, WAVELENGTH, FRAMES = 2 * np.pi, 8e-6, 0.4, 520e-9, 8
EYEBOX = WAVELENGTH * FOCAL / PITCH
DIAMETERS, VIEWS = (2e-3, 20e-3), 9
STILL_LIFE = 0.3173076923076923 / 64          # depth of builtin:still-life to either side, mm, for each pixel of the display's side
COLUMNS = ["step", "seconds", "processor seconds", "mean dB", "worst dB", "exposure", "exposure that fits best"]


def zernike(j, x, y):
    n = math.ceil((-3 + math.sqrt(9 + 8 * j)) / 2)
    m = 2 * j - n * (n + 2)
    k = np.arange((n - abs(m)) // 2 + 1)
    c = [(-1) ** i * math.comb(n - i, i) * math.comb(n - 2 * i, (n - abs(m)) // 2 - i) for i in k]
    radial = sum(a * (x * x + y * y) ** ((n - abs(m)) // 2 - i) for a, i in zip(c, k))
    angular = (x + 1j * y) ** abs(m)
    return math.sqrt((n + 1) * (2 if m else 1)) * radial * (angular.imag if m < 0 else angular.real)


def crosstalk(n, below, above):
    """Returns the kernel of one axis as an n x n matrix. `below` and `above` are (q, sigma) of its two sides."""
    k, l = np.fft.fftfreq(n), np.arange(-100, 101)[:, None]
    side = lambda q, sigma: ifft((np.sinc(k + l) ** 2 * np.exp(-(np.abs(k + l) / sigma) ** q)).sum(0)).real
    kernel = np.where(np.fft.fftfreq(n) < 0, side(*below), side(*above))
    kernel[0] = (side(*below)[0] + side(*above)[0]) / 2
    return (kernel / kernel.sum())[(np.arange(n)[:, None] - np.arange(n)) % n]


class Display:
    """Converts phases (frames, n, n) to the spectrum, with the middle of the eyebox in the middle, and back."""

    def __init__(self, n, terms):
        self.n, self.terms = n, terms
        at = (2 * np.arange(n) + 1) / n - 1
        y, x = at[:, None], at[None, :]
        hat = np.stack([np.maximum(0, 1 - np.abs(at - node)) for node in (-1, 0, 1)], 1)
        self.level = hat @ np.array(terms.get("level", np.ones((3, 3))), float) @ hat.T
        self.bend = terms.get("bend", (0.0, 0.0))
        h = terms.get("lag", 0.0)
        share = (1 - h) / (1 - h**FRAMES) * h ** np.arange(FRAMES) if h else np.eye(FRAMES)[0]
        self.lag = share[(np.arange(FRAMES)[:, None] - np.arange(FRAMES)) % FRAMES]
        sides = terms.get("crosstalk")
        self.blur = (crosstalk(n, *sides[:2]), crosstalk(n, *sides[2:]).T.copy()) if sides else None
        c = terms.get("source", [0.0] * 5)
        a = np.exp(c[0] * x + c[1] * y + c[2] * x * x + c[3] * x * y + c[4] * y * y)
        a = a / np.sqrt((a**2).mean())
        e = terms.get("undiffracted", [0.0] * 5)
        eta = e[0] + 1j * e[1]
        center = (-1.0) ** np.add.outer(np.arange(n), np.arange(n))      # a shift of the spectrum by n / 2
        self.modulated = a * np.sqrt(1 - abs(eta) ** 2) * center
        self.rest = a * eta * np.exp(1j * (e[2] * x + e[3] * y + e[4] * (x * x + y * y))) * center
        self.bins = np.arange(n) - n // 2
        one = np.sinc(terms.get("fill", 0.0) * self.bins / n)
        self.aperture = one[:, None] * one
        self.wavefront = {int(j): v for j, v in terms.get("wavefront", {}).items()}
        self.iris = terms.get("iris", (0.0, 0.0, 1.0))

    def spectrum(self, phases):
        w = np.mod(phases, TAU)
        sin, cos = np.sin(w), np.cos(w)
        driven = self.level * w + self.bend[0] * sin + self.bend[1] * (1 - cos)
        W = np.tensordot(self.lag, driven, 1)
        if self.blur:
            W = self.blur[0] @ W @ self.blur[1]
        u = np.empty(W.shape, complex)
        u.real, u.imag = self.modulated * np.cos(W), self.modulated * np.sin(W)
        self.kept = u, self.level + self.bend[0] * cos + self.bend[1] * sin
        return fft(fft(u + self.rest, axis=2), axis=1) * self.aperture

    def adjoint(self, back):
        """Returns the gradient in the phases of the last `spectrum`, from the gradients of the pupils.

        The wrap of the phases has the gradient 1.
        """
        u, slope = self.kept
        g = ifft(ifft(back * self.aperture, axis=1), axis=2)
        t = 2 * (g.imag * u.real - g.real * u.imag)
        if self.blur:
            t = self.blur[0].T @ t @ self.blur[1].T
        return np.tensordot(self.lag.T, t, 1) * slope

    def pupil(self, p):
        """Returns the first row and column, the kernel and the share of the eyebox of a pupil.

        A pupil is (x, y, diameter, depth), in meters.
        """
        x, y, d = p[0] * self.iris[2] + self.iris[0] * 1e-3, p[1] * self.iris[2] + self.iris[1] * 1e-3, p[2] * self.iris[2]
        X = self.bins * EYEBOX / self.n
        passes = (X[None, :] - x) ** 2 + (X[:, None] - y) ** 2 < (d / 2) ** 2
        rows, columns = np.flatnonzero(passes.any(1)), np.flatnonzero(passes.any(0))
        rows, columns = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        gx, gy = X[None, columns], X[rows, None]
        a = (gx**2 + gy**2) / FOCAL**2
        turns = -p[3] / WAVELENGTH * a / (1 + np.sqrt(1 - a))
        turns = turns + sum(c * zernike(j, gx / (EYEBOX / 2), gy / (EYEBOX / 2)) for j, c in self.wavefront.items())
        return rows, columns, passes[rows, columns] * np.exp(1j * TAU * turns), np.pi / 4 * (d / EYEBOX) ** 2


class Scene:
    def __init__(self, folder, depth=None):
        self.views = np.array([np.load(pathlib.Path(folder) / f"{i}.npy").reshape(-1) for i in range(VIEWS**2)], float)
        self.n = math.isqrt(self.views.shape[1])
        self.views = self.views.reshape(VIEWS, VIEWS, self.n, self.n)
        self.cell = EYEBOX / VIEWS
        self.depth = (depth or STILL_LIFE * self.n) * 1e-3

    def draw(self, random, count):
        out = []
        for u in random.uniform(size=(count, 4)):
            d = DIAMETERS[0] + (DIAMETERS[1] - DIAMETERS[0]) * u[0]
            out.append((*(u[1:3] * 2 - 1) * (EYEBOX - d) / 2, d, (2 * u[3] - 1) * self.depth))
        return out

    def photograph(self, p):
        """Returns the target image as a shift-and-add of the views in the pupil, averaged over 2 x 2 pixels."""
        x, y, d, z = p
        places = (np.arange(VIEWS) - (VIEWS - 1) / 2) * self.cell
        at = (places[:, None] + ((np.arange(200) + 0.5) / 200 - 0.5) * self.cell - x)             # samples across each column
        half = np.sqrt(np.maximum(0, d * d / 4 - at**2))
        edge = lambda s: np.clip(places[:, None, None] + s * self.cell / 2 - y, -half, half)
        share = (edge(1) - edge(-1)).mean(2)                              # (row, column) of views
        if not share.any():
            share[np.abs(places - y).argmin(), np.abs(places - x).argmin()] = 1
        share /= share.sum()
        total, scale = 0, z / FOCAL / PITCH
        moved = lambda a, s, axis: (1 - s % 1) * np.roll(a, math.floor(s), axis) + s % 1 * np.roll(a, math.floor(s) + 1, axis)
        for r in np.flatnonzero(share.any(1)):
            row = sum(share[r, c] * moved(self.views[r, c], scale * places[c], 1) for c in np.flatnonzero(share[r]))
            total = total + moved(row, scale * places[r], 0)
        return pooled(total)


def pooled(a):
    return a.reshape(a.shape[0] // 2, 2, -1, 2).mean((1, 3))


def seen(U, n, pupil):
    """Returns the fields of all sub-frames (each turned by a linear phase), and the picture after averaging."""
    rows, columns, K, share = pupil
    v = ifft(ifft(U[:, rows, columns] * K, n, axis=2), n, axis=1)
    return v, pooled((v.real**2 + v.imag**2).mean(0)) / share


def loss_and_gradient(display, phases, log_exposure, pupils, targets):
    """Returns minus the mean PSNR in dB, and its gradients in the phases and in the logarithm of the exposure."""
    U = display.spectrum(phases)
    back, loss, slope, exposure, n = np.zeros_like(U), 0.0, 0.0, np.exp(log_exposure), display.n
    for pupil, target in zip(pupils, targets):
        rows, columns, K, share = pupil
        v, picture = seen(U, n, pupil)
        error = exposure * picture - target
        mse = (error**2).mean()
        loss += 10 * np.log10(mse) / len(pupils)
        e = 20 / np.log(10) / len(pupils) / mse / error.size * error       # by the exposed picture
        slope += (e * exposure * picture).sum()
        e = np.repeat(np.repeat(e * (exposure / share / FRAMES / 4), 2, 0), 2, 1)
        v = fft(e * v, axis=1)[:, :K.shape[0]]
        back[:, rows, columns] += np.conj(K) * fft(v, axis=2)[:, :, :K.shape[1]]
    return loss, display.adjoint(back), slope


def judge(display, phases, pupils, targets):
    """Returns the PSNR of each pupil at the one exposure that fits all of them, and that exposure."""
    U = display.spectrum(phases)
    pictures = np.array([seen(U, display.n, pupil)[1] for pupil in pupils])
    exposure = (pictures * targets).sum() / (pictures**2).sum()
    return -10 * np.log10(((exposure * pictures - targets) ** 2).mean((1, 2))), exposure


def descend(display, scene, phases, exposure, asked, held_out, out):
    random = np.random.default_rng(asked.seed)
    drawn = scene.draw(random, asked.set)
    pupils, targets = [display.pupil(p) for p in drawn], [scene.photograph(p) for p in drawn]
    m, v, log_exposure = np.zeros_like(phases), np.zeros_like(phases), np.log(exposure)
    ms = vs = 0.0
    began, cpu, step, order, history, done = time.time(), time.process_time(), 0, [], [], 0.0
    while done < 1:
        done = max(step / asked.steps, (time.time() - began) / asked.seconds)
        batch = round(asked.batch[0] * (asked.batch[1] / asked.batch[0]) ** min(1, done))
        if len(order) < batch:
            order = list(random.permutation(asked.set))
        some, order = order[:batch], order[batch:]
        _, g, gs = loss_and_gradient(display, phases, log_exposure, [pupils[i] for i in some], [targets[i] for i in some])
        rate = asked.rate * (0.5 + 0.5 * np.cos(np.pi * min(1, done))) + 1e-5
        step += 1
        m, v = 0.9 * m + 0.1 * g, 0.99 * v + 0.01 * g * g
        phases = phases - rate * (m / (1 - 0.9**step)) / (np.sqrt(v / (1 - 0.99**step)) + 1e-12)
        if display.blur and done > asked.hold:                             # a blurred edge between 0 and 2 pi costs light
            phases = np.clip(phases, 0, TAU - 1e-9)
        elif display.blur:
            phases = np.mod(phases, TAU)
        ms, vs = 0.9 * ms + 0.1 * gs, 0.99 * vs + 0.01 * gs * gs
        if done > asked.free_exposure:
            log_exposure -= 0.1 * rate * (ms / (1 - 0.9**step)) / (np.sqrt(vs / (1 - 0.99**step)) + 1e-12)
        if step % asked.every == 0 or done >= 1:
            db, fitted = judge(display, phases, *held_out)
            history.append([step, round(time.time() - began), round(time.process_time() - cpu, 1), round(db.mean(), 3), round(db.min(), 3),
                            round(float(np.exp(log_exposure)), 4), round(fitted, 4)])
            print(*history[-1], batch, f"{done:.3f}", flush=True)
            np.save(out, phases)                                          # the last state, which the judging pupils did not choose
    return history


def check(folder):
    sys.path.insert(0, folder)
    import oracle
    random, n = np.random.default_rng(0), 24
    terms = {"level": random.uniform(0.9, 1.1, (3, 3)), "bend": [0.1, -0.05], "lag": 0.1, "crosstalk": [[1.3, 2.9], [1.2, 2.3], [1.25, 2.0], [1.4, 1.9]],
             "fill": 0.94, "source": [0.01, 0.06, -0.34, -0.03, -0.24], "undiffracted": [0.09, 0.2, 0.5, -0.1, 0.3],
             "wavefront": {3: 0.02, 4: 0.03, 8: 0.05, 10: -0.06, 12: -0.02}, "iris": [0.12, 0.04, 1.001]}
    optics = oracle.Optics(n, n, PITCH, WAVELENGTH, FOCAL)
    ct = terms["crosstalk"]
    bench = oracle.Bench(optics, 1, ct, terms["fill"], terms["level"], terms["bend"], terms["lag"], terms["source"], terms["undiffracted"],
                         terms["wavefront"], None, (0.12e-3, 0.04e-3, 1.001))
    phases = random.uniform(0, TAU, (FRAMES, n, n))
    drawn = [(2e-3, -1e-3, 9e-3, 0.3e-3), (-4e-3, 3e-3, 5e-3, -0.2e-3), (0.0, 0.0, 20e-3, 1e-3)]
    for terms_of, b in ((terms, bench), ({}, None)):
        display = Display(n, terms_of)
        U = display.spectrum(phases)
        pupils = [display.pupil(p) for p in drawn]
        for p, pupil in zip(drawn, pupils):
            want = pooled(oracle.view(phases, optics, p, b))
            off = np.abs(seen(U, n, pupil)[1] - want).max() / want.max()
            print(f"{'bench' if b else 'ideal'}: view off by {off:.1e} of its maximum")
            assert off < 1e-9
        targets = random.uniform(0, 1, (3, n // 2, n // 2))
        f = lambda a, s: loss_and_gradient(display, a, s, pupils, targets)
        _, g, gs = f(phases, -0.5)
        way = random.normal(size=phases.shape)
        numeric = (f(phases + 1e-6 * way, -0.5 + 1e-6)[0] - f(phases - 1e-6 * way, -0.5 - 1e-6)[0]) / 2e-6
        exact = (g * way).sum() + gs
        print(f"gradient {exact:.9e}, by differences {numeric:.9e}")
        assert abs(numeric - exact) < 1e-5 * abs(exact)
    random = np.random.default_rng(1)
    scene = Scene.__new__(Scene)
    scene.n, scene.cell, scene.views = n, EYEBOX / VIEWS, random.uniform(size=(VIEWS, VIEWS, n, n))
    xy = np.array([((i % 9 - 4) * scene.cell, (i // 9 - 4) * scene.cell) for i in range(81)])
    for p in drawn:
        want = pooled(oracle.photograph(scene.views.reshape(81, n, n), xy, scene.cell, optics, p))
        print(f"photograph off by {np.abs(scene.photograph(p) - want).max():.1e}, where the oracle counts samples of cells")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("--display", "--views", "--start", "--judge", "--pupils", "--check", "-o"):
        parser.add_argument(name)
    for name, default in (("--seconds", 1e9), ("--rate", 0.1), ("--exposure", 0.4), ("--hold", 0.5), ("--free-exposure", 0.3)):
        parser.add_argument(name, type=float, default=default)
    for name, default in (("--steps", 4000), ("--count", 24), ("--seed", 0), ("--set", 1000), ("--every", 100)):
        parser.add_argument(name, type=int, default=default)
    parser.add_argument("--depth", type=float, help="depth of the scene to either side of the display, mm [default: the still life's]")
    parser.add_argument("--batch", type=int, nargs=2, default=(4, 16))
    asked = parser.parse_args()
    if asked.check:
        return check(asked.check)
    file = tomllib.loads(pathlib.Path(asked.display).read_text())
    scene = Scene(asked.views, asked.depth)
    display = Display(scene.n, file.get("model", {}).get("green", {}))
    if asked.pupils:                                                      # those of `eyebox eval score --json`
        judging = [[v * 1e-3 for v in row["pupil_mm"]] for row in json.loads(pathlib.Path(asked.pupils).read_text())["pupils"]]
    else:
        judging = scene.draw(np.random.default_rng(123456), asked.count)
    held_out = [display.pupil(p) for p in judging], np.array([scene.photograph(p) for p in judging])
    if asked.judge:
        db, exposure = judge(display, np.load(asked.judge).reshape(FRAMES, scene.n, scene.n).astype(float), *held_out)
        print(f"mean {db.mean():.3f}, worst {db.min():.3f} dB at the exposure {exposure:.4f}")
        return
    phases = np.random.default_rng(asked.seed + 1000).uniform(0, TAU, (FRAMES, scene.n, scene.n))
    if asked.start:
        phases = np.load(asked.start).reshape(phases.shape).astype(float)
    history = descend(display, scene, phases, asked.exposure, asked, held_out, asked.o)
    pathlib.Path(asked.o + ".json").write_text(json.dumps({"asked": vars(asked), "columns": COLUMNS, "history": history}))


if __name__ == "__main__":
    main()
