//! Cuts of a run's mesh: options of `dsdf mesh` and `dsdf eval`.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::{Args, ValueEnum};
use export::cut::{
    CutReport, Cutter, PlaneReport, Region, Step, ground, inside_masks, seen_vertices,
};
use glam::DVec3;

use super::common::{ARGUMENTS, Global, with_fitted_cameras};
use ::mesh::{Components, Mesh, keep_components};
use dataset::Dataset;
use files::InputError;
use fit::{Model, RunFile, Solid};
use metrics::SurfacePoint;
use render::Camera;
use render::upwards;

/// The faces that photographs cut off.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum Cull {
    /// None
    #[default]
    None,
    /// Those that no training photograph sees: hidden, turned away, or off all films
    Seen,
    /// Those outside the object's mask, dilated by --mask-margin, in a view that shows them
    Masks,
}

/// The options of cuts by photographs.
#[derive(Args, Debug)]
pub(crate) struct CullOptions {
    /// Faces to cut off, by photographs
    #[arg(long, help_heading = "Cuts", value_enum, default_value_t)]
    cull: Cull,
    /// Dilation of masks, as a part of the image's width [default: 0.03125, 50 of 1600 pixels]
    #[arg(help_heading = "Cuts")]
    #[arg(long, value_name = "PART", value_parser = part, default_value = "0.03125",
          hide_default_value = true)]
    mask_margin: f64,
}

/// The options of all cuts.
#[derive(Args, Debug)]
pub(crate) struct CutOptions {
    #[command(flatten)]
    culling: CullOptions,
    /// Region to cut the mesh to, in data set units; may be given again:
    /// box:x0,y0,z0,x1,y1,z1 or sphere:x,y,z,radius
    #[arg(long, help_heading = "Cuts", value_name = "REGION")]
    crop: Vec<Region>,
    /// Cut off the table and all below it: the largest flat, level part of the surface, up to this
    /// height above it, in bounding radii; auto is 0.01
    #[arg(long, help_heading = "Cuts", value_name = "HEIGHT")]
    above: Option<Height>,
    /// Data set folder for --cull, --above, colours and the upward direction [default: the data set
    /// of the run]
    #[arg(long)]
    pub(super) dataset: Option<PathBuf>,
    /// Whether a cut without a table, or one that would leave nothing, is left out.
    #[arg(skip)]
    pub(super) is_lenient: bool,
}

/// A height above the table, in bounding radii.
#[derive(Clone, Copy, Debug)]
struct Height(f64);

impl FromStr for Height {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" { Ok(Height(0.01)) } else { part(text).map(Height) }
    }
}

/// A number from 0 to 1.
fn part(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|n| (0.0..=1.0).contains(n));
    number.ok_or_else(|| "expected a number from 0 to 1".to_owned())
}

/// A run whose mesh is cut.
pub(super) struct Subject<'a> {
    /// The model.
    pub(super) model: &'a Model,
    /// The folder of the run.
    pub(super) run: &'a Path,
    /// The run's input.
    pub(super) file: &'a RunFile,
    /// The data set in the place of the run's, if another one is asked for.
    pub(super) dataset: Option<&'a Path>,
    /// Grid cells of the mesh along the diameter of the bounding sphere.
    pub(super) cells: usize,
}

impl CullOptions {
    /// Whether there is something to cut.
    pub(super) fn is_active(&self) -> bool {
        self.cull != Cull::None
    }

    /// The mesh of a run after these cuts. The views are relative to the run's origin.
    ///
    /// # Errors
    /// If masks are missing, if nothing is left, or if the field gives a NaN or an infinity.
    pub(super) fn apply(
        &self,
        mesh: Mesh,
        subject: &Subject<'_>,
        dataset: &Dataset,
        global: &Global,
    ) -> anyhow::Result<(Mesh, Vec<CutReport>)> {
        if !self.is_active() || mesh.faces.is_empty() {
            return Ok((mesh, Vec::new()));
        }
        let mut cutting = Cutting::new(&mesh, subject, Some(dataset), global);
        cutting.cull(self)?;
        cutting.finish()
    }
}

impl CutOptions {
    /// The mesh of a run after these cuts. The data set is read if a cut needs it.
    ///
    /// # Errors
    /// As [`CullOptions::apply`], and if the data set cannot be read or there is no table.
    pub(super) fn apply(
        &self,
        mesh: Mesh,
        subject: &Subject<'_>,
        global: &Global,
    ) -> anyhow::Result<(Mesh, Vec<CutReport>)> {
        let by_views = self.culling.is_active() || self.above.is_some();
        if !by_views && self.crop.is_empty() {
            return Ok((mesh, Vec::new()));
        }
        let dataset = match by_views {
            true => {
                let mut dataset = views_of_run(subject.file, subject.dataset)?;
                let is_other = subject.dataset.is_some();
                with_fitted_cameras(subject.run, subject.file, &mut dataset, is_other)?;
                Some(dataset)
            }
            false => None,
        };
        let mut cutting = Cutting::new(&mesh, subject, dataset.as_ref(), global);
        cutting.cull(&self.culling)?;
        for region in &self.crop {
            cutting.crop(region);
        }
        if let Some(Height(height)) = self.above
            && !cutting.keep_above(height)?
        {
            let found = "no flat part of the seen surface, within 45 degrees of level, with other \
                parts above it";
            if !self.is_lenient {
                return Err(InputError::new(ARGUMENTS, "--above", found, "a table").into());
            }
            global.say(&format!("mesh: no table is cut off, for there is {found}"));
        }
        if self.is_lenient && cutting.is_empty() {
            global.say("mesh: the cuts would leave nothing, so nothing is cut off");
            return Ok((mesh, Vec::new()));
        }
        cutting.finish()
    }
}

/// The data set of a run as the run sees it, or another one.
pub(super) fn views_of_run(file: &RunFile, other: Option<&Path>) -> anyhow::Result<Dataset> {
    Ok(file.prepare(file.read(other)?))
}

/// A mesh that is being cut.
struct Cutting<'a> {
    mesh: &'a Mesh,
    subject: &'a Subject<'a>,
    dataset: Option<&'a Dataset>,
    global: &'a Global,
    vertices: Vec<SurfacePoint>,
    /// Whether a photograph sees each vertex, once it is known.
    seen: Option<Vec<bool>>,
    cutter: Cutter<'a>,
    reports: Vec<CutReport>,
}

impl<'a> Cutting<'a> {
    fn new(
        mesh: &'a Mesh,
        subject: &'a Subject<'a>,
        dataset: Option<&'a Dataset>,
        global: &'a Global,
    ) -> Self {
        Cutting {
            mesh,
            subject,
            dataset,
            global,
            vertices: export::cut::vertices_with_normals(mesh),
            seen: None,
            cutter: Cutter::new(mesh),
            reports: Vec::new(),
        }
    }

    fn report(&mut self, by: &'static str, step: Step, plane: Option<PlaneReport>) {
        let Step { faces, area } = step;
        self.reports.push(CutReport { by, faces, area, plane });
    }

    fn cull(&mut self, options: &CullOptions) -> anyhow::Result<()> {
        match options.cull {
            Cull::None => {}
            Cull::Seen => {
                let step = self.seen()?;
                let step = self.cutter.keep_touching(&step);
                self.report("seen", step, None);
            }
            Cull::Masks => {
                let inside = self.inside_masks(options.mask_margin)?;
                let step = self.cutter.keep_touching(&inside);
                self.report("masks", step, None);
            }
        }
        Ok(())
    }

    /// Whether a training photograph sees each vertex.
    fn seen(&mut self) -> anyhow::Result<Vec<bool>> {
        if let Some(seen) = &self.seen {
            return Ok(seen.clone());
        }
        let views = self.dataset.map_or(&[][..], |dataset| &dataset.train);
        let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
        let Subject { model, file, cells, .. } = self.subject;
        let solid = Solid::new(model, file);
        // A cell is more than the error of the mesh, and rays have a precision of their own.
        let tolerance = file.sphere().radius * (2.0 / *cells as f64).max(1.0 / 256.0);
        let bar = self.global.progress("visibility");
        let (scene, all) = (solid.scene(&cameras), 0..cameras.len());
        let moved = bar.mover();
        let seen = seen_vertices(&scene, all, views, &self.vertices, tolerance, &moved)?;
        bar.finish_and_clear();
        self.seen = Some(seen.clone());
        Ok(seen)
    }

    fn inside_masks(&self, margin: f64) -> Result<Vec<bool>, InputError> {
        let positions: Vec<DVec3> = self.vertices.iter().map(|v| v.position).collect();
        let views = self.dataset.iter().flat_map(|d| d.train.iter().chain(&d.test));
        inside_masks(views, &positions, margin).ok_or_else(|| {
            let path = self.dataset.map_or(Path::new(""), |dataset| &dataset.path);
            let found = "no view with a mask of the object";
            InputError::new(path, "masks", found, "one or more, for --cull masks")
        })
    }

    fn crop(&mut self, region: &Region) {
        let origin = self.mesh.origin;
        let inside: Vec<bool> =
            self.vertices.iter().map(|v| region.contains(origin + v.position)).collect();
        let step = self.cutter.keep_inside(&inside);
        self.report("crop", step, None);
    }

    /// Keeps what is above the table; false if there is none.
    fn keep_above(&mut self, height: f64) -> anyhow::Result<bool> {
        let seen = self.seen()?;
        let sphere = self.subject.file.sphere();
        let views = self.dataset.map_or(&[][..], |dataset| &dataset.train);
        let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
        let eyes: Vec<DVec3> = cameras.iter().map(|camera| camera.eye).collect();
        let areas = self.mesh.vertex_areas();
        let (points, areas): (Vec<SurfacePoint>, Vec<f64>) =
            (0..seen.len()).filter(|i| seen[*i]).map(|i| (self.vertices[i], areas[i])).unzip();
        let up = upwards(&cameras, sphere.center);
        let Some(found) = ground(&points, &areas, &eyes, up, sphere.radius) else {
            return Ok(false);
        };
        let least = height * sphere.radius;
        let above: Vec<bool> =
            self.vertices.iter().map(|v| found.plane.height(v.position) > least).collect();
        let step = self.cutter.keep_inside(&above);
        self.report("above", step, Some(PlaneReport::new(&found, self.mesh.origin)));
        Ok(true)
    }

    /// Whether no face is left.
    fn is_empty(&self) -> bool {
        self.cutter.mesh().faces.is_empty()
    }

    /// The rest without its small components.
    fn finish(mut self) -> anyhow::Result<(Mesh, Vec<CutReport>)> {
        let rest = keep_components(self.cutter.mesh(), Components::default());
        if rest.faces.is_empty() {
            let found = format!("no face left of {}", self.mesh.faces.len());
            let expected = "cuts that leave a part of the surface";
            return Err(InputError::new(ARGUMENTS, self.flags(), found, expected).into());
        }
        let step = self.cutter.step_to(&rest);
        self.report("pieces", step, None);
        Ok((rest, self.reports))
    }

    /// The flags of the cuts, for a message.
    fn flags(&self) -> String {
        let flag = |report: &CutReport| match report.by {
            by @ ("crop" | "above") => format!("--{by}"),
            by => format!("--cull {by}"),
        };
        self.reports.iter().map(flag).collect::<Vec<_>>().join(", ")
    }
}
