//! `dsdf query`.

use std::path::PathBuf;

use clap::Args;
use field::Field;
use glam::Vec3;
use serde::Serialize;

use super::common::{Global, check_extension};
use io::InputError;
use io::{read_npy, write_npy};
use scene::network;

/// Evaluate a model file at points.
#[derive(Args, Debug)]
pub(crate) struct Query {
    /// The model, a .safetensors file
    model: PathBuf,
    /// The points, N x 3, a .npy file
    points: PathBuf,
    /// Where to write the values (N), or values and gradients (N x 4)
    #[arg(short, long)]
    output: PathBuf,
    /// Write gradients beside the values
    #[arg(long)]
    gradient: bool,
}

#[derive(Serialize)]
struct Report {
    points: usize,
}

impl Query {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        check_extension(&self.output, &["npy"])?;
        let bytes = std::fs::read(&self.model)
            .map_err(|e| InputError::new(&self.model, "model", e, "a model file"))?;
        let field = network::<f32>(&self.model, &bytes)?;
        let (shape, data) = read_npy(&self.points)?;
        let &[n, 3] = shape.as_slice() else {
            return Err(
                InputError::new(&self.points, "shape", format!("{shape:?}"), "[N, 3]").into()
            );
        };
        if let Some(bad) = data.iter().position(|v| !v.is_finite()) {
            let field = format!("point {}", bad / 3);
            return Err(InputError::new(&self.points, field, data[bad], "a finite number").into());
        }
        let points: Vec<Vec3> = data.chunks_exact(3).map(Vec3::from_slice).collect();
        let (mut f, mut g) = (vec![0.0; n], vec![Vec3::ZERO; n]);
        if self.gradient {
            field.value_gradient(&points, &mut f, &mut g);
        } else {
            field.value(&points, &mut f);
        }
        if let Some(bad) = (0..n).find(|&i| !f[i].is_finite() || !g[i].is_finite()) {
            let expected = "a point where the network is finite";
            return Err(InputError::new(
                &self.points,
                format!("point {bad}"),
                points[bad],
                expected,
            )
            .into());
        }
        if self.gradient {
            let rows: Vec<f32> = f.iter().zip(&g).flat_map(|(f, g)| [*f, g.x, g.y, g.z]).collect();
            write_npy(&self.output, &[n, 4], &rows)?;
        } else {
            write_npy(&self.output, &[n], &f)?;
        }
        global.report(&Report { points: n }, || format!("{n} points: {}", self.output.display()))
    }
}
