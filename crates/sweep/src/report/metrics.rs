//! The numbers of a cell's result: names, units, and their use in comparisons.

/// A number of a cell's result.
#[derive(Debug)]
pub struct Metric {
    /// The column in `results.csv`.
    pub name: &'static str,
    /// The name in reports.
    pub label: &'static str,
    /// Whether a small or a large number is good.
    pub better: Better,
    /// The number that counts for a fit without a result; NaN excludes such fits from comparisons.
    pub worst: f64,
    /// Errors below this number are taken as equal to it.
    pub least: f64,
    /// Factor and unit in reports.
    pub shown: (f64, &'static str),
}

/// Which numbers of a metric are good.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Better {
    /// Small ones: an error.
    Less,
    /// Large ones: a score.
    More,
    /// Small ones: the cost of a fit, which is no error of its result.
    Cost,
}

/// Columns `name` and `label`, direction, `[worst, least]`, `(factor, unit)`.
const fn metric_of(
    name: &'static str,
    label: &'static str,
    better: Better,
    [worst, least]: [f64; 2],
    shown: (f64, &'static str),
) -> Metric {
    Metric { name, label, better, worst, least, shown }
}

/// The relative bias of a gradient. A difference below 1 % is not resolved.
const fn bias(name: &'static str, label: &'static str) -> Metric {
    metric_of(name, label, Better::Less, [f64::NAN, 1e-2], (100.0, " %"))
}

/// The relative variance of a gradient.
const fn variance(name: &'static str, label: &'static str) -> Metric {
    metric_of(name, label, Better::Less, [f64::NAN, 1e-4], (1.0, ""))
}

/// A score between 0 and 1.
const fn score(name: &'static str, label: &'static str) -> Metric {
    metric_of(name, label, Better::More, [0.0, 1e-4], (1.0, ""))
}

/// A mean loss.
const fn loss(name: &'static str, label: &'static str) -> Metric {
    metric_of(name, label, Better::Less, [1.0, 1e-9], (1e3, ""))
}

/// A cost.
const fn cost(name: &'static str, label: &'static str, shown: (f64, &'static str)) -> Metric {
    metric_of(name, label, Better::Cost, [f64::NAN, 1e-9], shown)
}

/// Millions.
const MILLIONS: (f64, &str) = (1e-6, " M");

/// All metrics, in the order of the columns of `results.csv`.
pub const METRICS: [Metric; 18] = [
    metric_of(
        "chamfer",
        "Chamfer distance, of the bounding radius",
        Better::Less,
        [1.0, 1e-6],
        (100.0, " %"),
    ),
    metric_of("psnr", "PSNR of held-out views", Better::More, [0.0, 1e-6], (1.0, " dB")),
    score("ssim", "SSIM of held-out views"),
    score("mask_iou", "mask IoU of held-out views"),
    score("f_score", "F-score at 1 % of the bounding radius"),
    metric_of("normal_error", "mean error of normals", Better::Less, [90.0, 1e-3], (1.0, "°")),
    loss("loss", "final loss, in thousandths"),
    loss("best_loss", "lowest loss, in thousandths"),
    bias("first_bias", "bias of the gradient, first iterate"),
    variance("first_variance", "variance of the gradient, first iterate"),
    bias("last_bias", "bias of the gradient, last iterate"),
    variance("last_variance", "variance of the gradient, last iterate"),
    cost("values", "values of f", MILLIONS),
    cost("gradients", "gradients of f", MILLIONS),
    cost("hessian_vectors", "Hessian–vector products", MILLIONS),
    cost("parameters", "parameter gradients", MILLIONS),
    cost("iterations", "iterations", (1.0, "")),
    cost("seconds", "seconds of the fit", (1.0, " s")),
];

/// The metric of a name.
pub fn metric(name: &str) -> Option<&'static Metric> {
    METRICS.iter().find(|m| m.name == name)
}

/// "one of" and all names, for refusals.
pub(crate) fn metric_names() -> String {
    format!("one of {}", METRICS.map(|m| m.name).join(", "))
}
