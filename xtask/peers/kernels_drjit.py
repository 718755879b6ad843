"""Measures passes of networks in Dr.Jit on CPUs, in points per second.

    python kernels_drjit.py [--threads N] [--points N ...]

The networks and passes are those of `cargo bench -p dsdf-sdf-nn --bench machine`: three hidden
layers of 64 with softplus (beta = 100), in single precision, behind

- the frequency encoding with six octaves: x, sin(2^i x), cos(2^i x), 39 features;
- a hash grid of `drjit.nn`: 16 levels of 2 features, 32 features.

The passes for each point x:

- value: f(x);
- value + gradient: f(x) and its gradient by x, in reverse mode;
- parameter VJP: the gradient by all parameters of the sum of alpha f(x) + c · grad f(x). Dr.Jit
  differentiates a computation once. So the derivative of f along c is written out here, and reverse
  mode differentiates the sum of alpha f and of it.

The matrices are `drjit.nn.Linear` layers, once packed for cooperative vectors, once as tensors. A
call traces Python and runs kernels that are compiled before ("traced"), or `dr.freeze` has recorded
it, and no Python is traced ("frozen"); the faster one counts. Frozen functions cannot record the
matrix products of tensors.
"""

import math

import peers

WIDTH, LAYERS = 64, 3


class Vectors:
    """Layers packed for cooperative vectors: one kernel evaluates the whole network for a point."""

    name, freezes = "cooperative vectors", True
    ran = "nn.Linear, nn.pack(layout='training'), nn.CoopVec"

    def __init__(self, plain):
        import drjit.nn as nn

        self.nn, self.net = nn, nn.pack(plain, layout="training")

    def parameters(self, net):
        return [net["weights"]]

    def wrap(self, features):
        return self.nn.CoopVec(*features)

    def unwrap(self, h):
        return list(h)[0]

    def times(self, layer, h):
        """The product with a layer's matrix, without its bias."""
        return self.nn.matvec(layer.weights, h)


class Tensors:
    """Layers that are tensors: matrix products for all points, with a kernel in between."""

    name, freezes = "tensors", False
    ran = "nn.Linear on tensors (features × points)"

    def __init__(self, plain):
        from drjit.llvm.ad import ArrayXf, TensorXf

        self.Array, self.Tensor, self.net = ArrayXf, TensorXf, plain

    def parameters(self, net):
        return [part for layer in net.layers for part in (layer.weights, layer.bias)]

    def wrap(self, features):
        return self.Tensor(self.Array(*features))

    def unwrap(self, h):
        return h.array

    def times(self, layer, h):
        """The product with a layer's matrix, without its bias."""
        return layer.weights @ h


class Network:
    """The passes of one network."""

    def __init__(self, dr, encoding, mode, seed):
        import drjit.nn as nn
        from drjit.llvm.ad import Float, TensorXf

        self.dr, self.Float = dr, Float
        self.grid = None
        if encoding == "hash grid":
            # The resolution grows from 16 to 2048 over the 16 levels.
            self.grid = nn.HashGridEncoding(
                Float, 3, n_levels=16, n_features_per_level=2, hashmap_size=2**19,
                base_resolution=16, per_level_scale=2 ** (7 / 15), rng=dr.rng(seed=seed))
        features = peers.FEATURES if self.grid is None else self.grid.n_output_features
        sizes = [features, *[WIDTH] * LAYERS, 1]
        linear = [nn.Linear(inputs, outputs) for inputs, outputs in zip(sizes, sizes[1:])]
        plain = nn.Sequential(*linear).alloc(TensorXf, features)
        for layer, (weight, bias) in zip(plain.layers, peers.weights(sizes, seed)):
            layer.weights, layer.bias = TensorXf(weight), TensorXf(bias)
        self.mode = mode(plain)
        self.net = self.mode.net
        self.description = f"{mode.ran}, {' - '.join(map(str, sizes))}, Float32"

    def frequencies(self, x):
        """The frequency encoding of three coordinates."""
        features = list(x)
        for band in range(peers.BANDS):
            pairs = [self.dr.sincos(v * 2.0**band) for v in x]
            features += [sine for sine, _ in pairs] + [cosine for _, cosine in pairs]
        return features

    def frequencies_along(self, x, c):
        """The frequency encoding, and its derivative along c."""
        features, slopes = list(x), list(c)
        for band in range(peers.BANDS):
            scale = 2.0**band
            pairs = [self.dr.sincos(v * scale) for v in x]
            features += [sine for sine, _ in pairs] + [cosine for _, cosine in pairs]
            slopes += [cosine * (d * scale) for (_, cosine), d in zip(pairs, c)]
            slopes += [-sine * (d * scale) for (sine, _), d in zip(pairs, c)]
        return features, slopes

    def grid_along(self, x, c):
        """The features of the hash grid, and their derivatives along c.

        Within a cell they are trilinear, so the derivative of the weights is elementary.
        """
        dr, grid = self.dr, self.grid
        size = grid.n_features_per_level
        features, slopes = [], []
        for level in range(grid.n_levels):
            scale = grid._level_scale(level)
            place = [dr.fma(v, scale, 0.5) for v in x]
            corner = [dr.floor(p) for p in place]
            part = [p - q for p, q in zip(place, corner)]
            base = [grid.UInt32(q) for q in corner]
            sums = [self.Float(0)] * (2 * size)
            for bits in range(8):
                key = [base[axis] + (bits >> axis & 1) for axis in range(3)]
                sides = [part[a] if bits >> a & 1 else 1 - part[a] for a in range(3)]
                rates = [c[a] * (scale if bits >> a & 1 else -scale) for a in range(3)]
                weight = sides[0] * sides[1] * sides[2]
                rate = (rates[0] * sides[1] * sides[2] + sides[0] * rates[1] * sides[2]
                        + sides[0] * sides[1] * rates[2])
                index = grid.indexing_function(key, level)
                stored = dr.gather(
                    grid.StorageFloatXf, grid.data, index, True, shape=(size, dr.width(index)))
                for k in range(size):
                    sums[k] = dr.fma(stored[k], weight, sums[k])
                    sums[size + k] = dr.fma(stored[k], rate, sums[size + k])
            features += sums[:size]
            slopes += sums[size:]
        return features, slopes

    def softplus(self, z):
        """log(1 + exp(beta z))/beta, without overflow."""
        dr = self.dr
        large = dr.maximum(z, 0)
        size = large - dr.minimum(z, 0)
        small = dr.log2(1 + dr.exp2(size * (-peers.BETA / math.log(2))))
        return large + small * (math.log(2) / peers.BETA)

    def evaluate(self, net, x):
        """f at points."""
        h = self.mode.wrap(self.frequencies(x) if self.grid is None else list(self.grid(x)))
        for layer in net.layers[:-1]:
            h = self.softplus(layer(h))
        return self.mode.unwrap(net.layers[-1](h))

    def evaluate_along(self, net, x, c):
        """f at points, and its derivative along c."""
        dr, mode = self.dr, self.mode
        along = self.frequencies_along if self.grid is None else self.grid_along
        h, d = (mode.wrap(part) for part in along(x, c))
        for layer in net.layers[:-1]:
            z = layer(h)
            # The derivative of softplus is a logistic function.
            rise = dr.tanh(z * (0.5 * peers.BETA)) * 0.5 + 0.5
            h, d = self.softplus(z), mode.times(layer, d) * rise
        last = net.layers[-1]
        return mode.unwrap(last(h)), mode.unwrap(mode.times(last, d))

    # What a frozen function reads must be among its arguments, so `table` is one.

    def value(self, net, table, x, c, alpha):
        del c, alpha
        self.use(table)
        return self.evaluate(net, x)

    def value_gradient(self, net, table, x, c, alpha):
        del c, alpha
        self.use(table)
        dr = self.dr
        x = [self.Float(v) for v in x]
        dr.enable_grad(x)
        value = self.evaluate(net, x)
        dr.backward_from(value)
        return dr.detach(value), dr.grad(x)

    def parameter_vjp(self, net, table, x, c, alpha):
        dr = self.dr
        parameters = self.mode.parameters(net)
        if self.grid is not None:
            table = type(table)(table)
            parameters.append(table)
        for parameter in parameters:
            dr.enable_grad(parameter)
        self.use(table)
        value, slope = self.evaluate_along(net, x, c)
        dr.backward_from(dr.sum(dr.fma(value, alpha, slope)))
        gradients = [dr.grad(parameter) for parameter in parameters]
        for parameter in parameters:
            dr.disable_grad(parameter)
        return gradients

    def use(self, table):
        """Makes the hash grid look up `table`."""
        if self.grid is not None:
            self.grid.data = table

    def table(self):
        return None if self.grid is None else self.grid.data


def check(network, x, c):
    """Two relative differences, of derivatives of f along c.

    The first is between the derivative that is written out and the gradient in reverse mode, the
    largest of all points. The second is between the parameter VJP with alpha = 0 for the weights of
    the last layer, times these weights, and the sum of the derivatives along c: they are equal,
    since the derivative is linear in these weights. None in a mode that packs the weights.
    """
    import numpy as np

    arguments = (network.net, network.table(), x, c)
    _, gradient = network.value_gradient(*arguments, 0.0)
    along = sum(np.array(g, np.float64) * np.array(v) for g, v in zip(gradient, c))
    _, slope = network.evaluate_along(network.net, x, c)
    first = float(np.abs(np.array(slope) - along).max() / np.abs(along).max())
    if not isinstance(network.mode, Tensors):
        return first, None
    last = len(network.net.layers) - 1
    weights = np.array(network.net.layers[last].weights, np.float64)
    gradients = network.parameter_vjp(*arguments, network.Float(0))
    product = float((np.array(gradients[2 * last]) * weights).sum())
    return first, abs(product - float(along.sum())) / float(np.abs(along).sum())


def measure(dr, network, encoding, count, options):
    """The row of one network and one number of points."""
    Float = network.Float
    x, c = ([Float(v) for v in peers.positions(count)] for _ in range(2))
    if encoding == "hash grid":
        x = [0.5 * v + 0.5 for v in x]
    alpha = Float(0.5)
    dr.make_opaque(x, c, alpha)
    first, second = check(network, x, c)
    row = {"encoding": encoding, "layers": network.mode.name, "points": count,
           "ran": network.description, "check_slope": first, "check_parameters": second,
           "passes": {}}
    cases = {"value": network.value, "value + gradient": network.value_gradient,
             "parameter VJP": network.parameter_vjp}
    for name, function in cases.items():
        variants = {"traced": function}
        entry = {"frozen": None}
        if network.mode.freezes:
            variants["frozen"] = dr.freeze(function)
        else:
            # It ends the process, so it is not tried.
            entry["reason_frozen"] = "dr.freeze cannot record the matrix products of tensors"
        for key, variant in variants.items():
            def work():
                dr.eval(variant(network.net, network.table(), x, c, alpha))
                dr.sync_thread()

            try:
                entry[key] = peers.measure(work, count, options.seconds, options.tries)
            except Exception as error:  # The peer's errors have many types.
                entry.update({key: None, f"reason_{key}": peers.failed(error)["reason"]})
        rates = [entry[key] for key in ("traced", "frozen") if entry[key]]
        entry["points_per_second"] = max(rates, key=lambda rate: rate["best"], default=None)
        row["passes"][name] = entry
        best = entry["points_per_second"]
        peers.progress(f"{encoding}, {network.mode.name}, {count} points, {name}: "
                       + (f"{best['best'] / 1e6:.3f} M points/s" if best else "failed"))
    return row


def main():
    options = peers.kernel_options(__doc__)
    peers.pin(options.threads)
    dr = peers.import_drjit()
    dr.set_thread_count(options.threads)
    rows = []
    for encoding in ("frequency", "hash grid"):
        for mode in (Vectors, Tensors):
            network = Network(dr, encoding, mode, options.seed)
            for count in options.points:
                rows.append(measure(dr, network, encoding, count, options))
    peers.write({
        "peer": "Dr.Jit, LLVM backend",
        "versions": {**peers.versions("drjit", "numpy"),
                     "llvm": ".".join(map(str, dr.detail.llvm_version()))},
        "machine": peers.machine(),
        "threads": dr.thread_count(),
        "precision": "f32",
        "protocol": {"tries": options.tries, "seconds": options.seconds, "warm_up": 3,
                     "excluded": "compilation, and in frozen functions the tracing of Python"},
        "notes": {
            "parameter VJP": "the derivative along c is written out, as Dr.Jit differentiates once",
            "hash grid": "another encoding than dsdf's, with 32 features; x is moved to [0, 1]"},
        "rows": rows,
    })


if __name__ == "__main__":
    main()
