//! `dsdf query`.

use std::path::PathBuf;

use clap::Args;
use field::{Field, SLOPE_POINTS, slope};
use glam::Vec3;
use sdf_nn::Network;
use serde::Serialize;

use super::common::Global;
use files::InputError;
use film::{read_npy, write_npy};
use scene::network;

/// Arguments of `dsdf query`.
#[derive(Args, Debug)]
pub(crate) struct Query {
    /// Model file (.safetensors)
    model: PathBuf,
    /// Points in world units, an N × 3 array (.npy)
    points: PathBuf,
    /// File to write: N values, or N × 4 values and gradients (.npy, float32)
    #[arg(short, long)]
    output: PathBuf,
    /// Write values and gradients
    #[arg(long)]
    gradient: bool,
}

/// The result of `dsdf query`.
#[derive(Serialize)]
struct QueryReport {
    /// Number of points.
    points: usize,
    /// The slope of the network: the 98 % quantile of |∇f| over its ball, or 1 if it is at most
    /// 1.5. Rays start with it.
    slope: f32,
}

/// The slope that rays start with.
pub(super) fn slope_of(network: &Network<f32>) -> f32 {
    network.bounds().map_or(1.0, |ball| slope(network, &ball, SLOPE_POINTS))
}

impl Query {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        global.will_write(&self.output, &["npy"])?;
        let bytes = files::read(&self.model, "model", "a model file")?;
        let network = network::<f32>(&self.model, &bytes)?;
        let points = self.read_points()?;
        let n = points.len();
        let slope = slope_of(&network);
        let (values, gradients) = self.evaluate(network, &points)?;
        if self.gradient {
            let rows = values.iter().zip(&gradients);
            let rows: Vec<f32> = rows.flat_map(|(f, g)| [*f, g.x, g.y, g.z]).collect();
            write_npy(&self.output, &[n, 4], &rows)?;
        } else {
            write_npy(&self.output, &[n], &values)?;
        }
        let report = QueryReport { points: n, slope };
        global.report(&report, || format!("{n} points: {}, slope {slope}", self.output.display()))
    }

    /// Reads the points.
    ///
    /// # Errors
    /// If the file cannot be read, has another shape, or has a number that is not finite.
    fn read_points(&self) -> anyhow::Result<Vec<Vec3>> {
        let (shape, data) = read_npy(&self.points)?;
        let &[_, 3] = shape.as_slice() else {
            let found = format!("{shape:?}");
            return Err(InputError::new(&self.points, "shape", found, "[N, 3]").into());
        };
        if let Some(bad) = data.iter().position(|v| !v.is_finite()) {
            let field = format!("point {}", bad / 3);
            return Err(InputError::new(&self.points, field, data[bad], "a finite number").into());
        }
        Ok(data.chunks_exact(3).map(Vec3::from_slice).collect())
    }

    /// The values at the points, and with `--gradient` the gradients; zeros without it.
    ///
    /// # Errors
    /// If a result is not finite.
    fn evaluate(
        &self,
        network: Network<f32>,
        points: &[Vec3],
    ) -> Result<(Vec<f32>, Vec<Vec3>), InputError> {
        // Single precision has the most digits relative to the network's centre.
        let center = network.transform().center;
        let network = network.about(center);
        let relative: Vec<Vec3> =
            points.iter().map(|p| (p.as_dvec3() - center).as_vec3()).collect();
        let n = points.len();
        let (mut values, mut gradients) = (vec![0.0; n], vec![Vec3::ZERO; n]);
        if self.gradient {
            network.value_gradient(&relative, &mut values, &mut gradients);
        } else {
            network.value(&relative, &mut values);
        }
        if let Some(bad) = (0..n).find(|&i| !values[i].is_finite() || !gradients[i].is_finite()) {
            let (field, expected) = (format!("point {bad}"), "a point where the network is finite");
            return Err(InputError::new(&self.points, field, points[bad], expected));
        }
        Ok((values, gradients))
    }
}
