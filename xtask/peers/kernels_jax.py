"""Measures passes of a network in JAX on CPUs, in points per second.

    python kernels_jax.py [--threads N] [--points N ...]

The network, the passes and the protocol are those of `cargo bench -p dsdf-sdf-nn --bench machine`:
three hidden layers of 64 with softplus (beta = 100) in single precision, behind the frequency
encoding with six octaves. Every pass is one call of a function under `jax.jit`:

- value: f(x);
- value + gradient: f(x) and its gradient by x, by `jax.vjp`;
- parameter VJP: the gradient by all parameters of the sum of alpha f(x) + c · grad f(x), by
  `jax.grad` of a `jax.jvp` along c.

XLA has no option for the number of its threads. The process is kept on as many cores before JAX
starts; with one thread, XLA is also told not to split its operations.
"""

import os

import peers

WIDTH, LAYERS = 64, 3


def passes(jax, jnp):
    """The passes, as functions of the layers, the points, c and alpha."""

    def field(layers, x):
        features = [x]
        for band in range(peers.BANDS):
            features += [jnp.sin(x * 2.0**band), jnp.cos(x * 2.0**band)]
        h = jnp.concatenate(features, axis=1)
        for weight, bias in layers[:-1]:
            h = jax.nn.softplus(peers.BETA * (h @ weight.T + bias)) / peers.BETA
        weight, bias = layers[-1]
        return (h @ weight.T + bias)[:, 0]

    def value(layers, x, c, alpha):
        del c, alpha
        return field(layers, x)

    def value_gradient(layers, x, c, alpha):
        del c, alpha
        f, pull = jax.vjp(lambda x: field(layers, x), x)
        return f, pull(jnp.ones_like(f))[0]

    def parameter_vjp(layers, x, c, alpha):
        def total(layers):
            f, slope = jax.jvp(lambda x: field(layers, x), (x,), (c,))
            return jnp.vdot(alpha, f) + slope.sum()

        return jax.grad(total)(layers)

    return {"value": value, "value + gradient": value_gradient, "parameter VJP": parameter_vjp}


def main():
    options = peers.kernel_options(__doc__)
    cores = peers.pin(options.threads)
    os.environ["JAX_PLATFORMS"] = "cpu"
    if options.threads == 1:
        flags = os.environ.get("XLA_FLAGS", "")
        os.environ["XLA_FLAGS"] = f"{flags} --xla_cpu_multi_thread_eigen=false".strip()
    try:
        import jax
    except ImportError as error:
        peers.skip(f"{error}: run install.py, and use the Python of its folder")
    import jax.numpy as jnp
    import numpy as np

    sizes = [peers.FEATURES, *[WIDTH] * LAYERS, 1]
    layers = [tuple(map(jnp.asarray, pair)) for pair in peers.weights(sizes, options.seed)]
    rows = []
    for count in options.points:
        x = jnp.asarray(np.stack(peers.positions(count), 1))
        alpha = jnp.full(count, 0.5, jnp.float32)
        row = {"encoding": "frequency", "points": count,
               "ran": f"jax.jit, {' - '.join(map(str, sizes))}, float32", "passes": {}}
        for name, function in passes(jax, jnp).items():
            compiled = jax.jit(function)

            def work():
                jax.block_until_ready(compiled(layers, x, x, alpha))

            try:
                rate = peers.measure(work, count, options.seconds, options.tries)
                row["passes"][name] = {"points_per_second": rate}
                peers.progress(f"{count} points, {name}: {rate['best'] / 1e6:.3f} M points/s")
            except Exception as error:  # The peer's errors have many types.
                row["passes"][name] = peers.failed(error)
        rows.append(row)
    peers.write({
        "peer": "JAX, CPU",
        "versions": peers.versions("jax", "jaxlib", "numpy"),
        "machine": peers.machine(),
        "threads": options.threads,
        "cores": cores,
        "precision": "f32",
        "protocol": {"tries": options.tries, "seconds": options.seconds, "warm_up": 3,
                     "excluded": "compilation"},
        "rows": rows,
    })


if __name__ == "__main__":
    main()
