//! `dsdf poses`.

use std::path::PathBuf;

use clap::Args;

use super::common::Global;
use crate::error::Interrupted;
use crate::messages::Progress;
use ::poses::{Event, Job, Options, Photographs, Poses as Found, Program, run};

/// Arguments of `dsdf poses`.
#[derive(Args, Debug)]
pub(crate) struct Poses {
    /// Folder of photographs: .jpg, .png, .tif or .webp
    photos: PathBuf,
    /// Data set folder to write; continues an existing folder of the same photographs from the
    /// first step whose options changed
    #[arg(short, long)]
    output: PathBuf,
    #[command(flatten)]
    options: Options,
    /// The program COLMAP [default: colmap on the search path]
    #[arg(long, value_name = "PROGRAM", help_heading = "COLMAP")]
    colmap: Option<PathBuf>,
}

impl Poses {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        let poses = self.find(global)?;
        global.report(&poses, || poses.text())
    }

    /// Finds the poses, from the first step on that is not done.
    pub(super) fn find(&self, global: &Global) -> anyhow::Result<Found> {
        let photographs = Photographs::in_folder(&self.photos)?;
        if let Some(left_out) = photographs.left_out() {
            global.say(&format!("WARNING {left_out}"));
        }
        let program = self.colmap.clone().map_or_else(Program::default, Program::at);
        let threads = rayon::current_num_threads();
        let (photographs, options) = (&photographs, &self.options);
        let job = Job { photographs, output: &self.output, options, program: &program, threads };
        let mut bar = None;
        let stop = || global.console.stop_requested();
        let found = global
            .console
            .while_iterating(|| run(&job, &stop, &mut |event| self.show(event, &mut bar, global)));
        if let Some(bar) = bar {
            bar.finish_and_clear();
        }
        let Some(poses) = found? else {
            global.console.line("stopped; the same command continues");
            return Err(Interrupted.into());
        };
        Ok(poses)
    }

    /// Shows the news of a run.
    fn show(&self, event: Event<'_>, bar: &mut Option<Progress>, global: &Global) {
        match event {
            Event::Kept([]) => {}
            Event::Decoding(fraction) => {
                let bar = bar.get_or_insert_with(|| global.progress("photographs"));
                bar.mover()(fraction);
            }
            Event::Kept(steps) => {
                let names: Vec<&str> = steps.iter().map(|step| step.name()).collect();
                global.say(&format!("done already: {}", names.join(", ")));
            }
            Event::Again(step) => {
                let text = "of a complete data set: options or COLMAP changed, or files are gone";
                global.say(&format!("again from {step} on, {text}"));
            }
            Event::Guided => {
                global.say("few photographs have a pose: matching again, guided (see --guided)");
            }
            Event::Started(step) => {
                if let Some(bar) = bar.take() {
                    bar.finish_and_clear();
                }
                *bar = Some(global.progress_with_text(step.name()));
            }
            Event::Progress { fraction, text, .. } => {
                if let Some(bar) = bar {
                    bar.show(fraction, &|| text.to_owned());
                }
            }
            Event::Finished(step) => {
                if let Some(bar) = bar.take() {
                    bar.finish_and_clear();
                }
                global.say(&format!("{step}: done"));
            }
        }
    }
}
