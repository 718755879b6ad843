//! Sweeps on clusters: shards, and the script of a Slurm job array.

use std::path::{Path, PathBuf};

use crate::report::Sweep;
use files::InputError;

/// A part of a sweep's cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Shard {
    /// From 0 to `count` − 1.
    pub(crate) index: usize,
    /// Number of shards.
    pub(crate) count: usize,
}

/// Refuses an argument or an environment variable.
fn refuse(field: &str, found: &str, expected: &str) -> InputError {
    InputError::new(Path::new("arguments"), field, found, expected)
}

impl Shard {
    /// The shard of an argument `I/N`, or else of the Slurm array task that runs this process.
    /// `None` stands for the whole sweep.
    ///
    /// `variable` reads environment variables.
    ///
    /// # Errors
    /// An [`InputError`] unless I is from 1 to N, or if the tasks of the array are not consecutive.
    pub(crate) fn read(
        argument: Option<&str>,
        variable: impl Fn(&str) -> Option<String>,
    ) -> Result<Option<Shard>, InputError> {
        match argument {
            Some(text) => Self::parse(text).map(Some),
            None => Self::of_array_task(variable),
        }
    }

    fn parse(text: &str) -> Result<Shard, InputError> {
        let numbers =
            text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match numbers {
            Some((i, count)) if (1..=count).contains(&i) => Ok(Shard { index: i - 1, count }),
            _ => Err(refuse("--shard", text, "I/N with I from 1 to N")),
        }
    }

    fn of_array_task(
        variable: impl Fn(&str) -> Option<String>,
    ) -> Result<Option<Shard>, InputError> {
        let Some(task) = variable("SLURM_ARRAY_TASK_ID") else { return Ok(None) };
        let number = |name: &str| variable(name).and_then(|v| v.parse::<usize>().ok());
        let (first, count) = (number("SLURM_ARRAY_TASK_MIN"), number("SLURM_ARRAY_TASK_COUNT"));
        match (task.parse::<usize>(), first, count) {
            (Ok(task), Some(first), Some(count)) if task >= first && task - first < count => {
                Ok(Some(Shard { index: task - first, count }))
            }
            _ => Err(refuse("SLURM_ARRAY_TASK_ID", &task, "an array of consecutive tasks")),
        }
    }

    /// Whether cell `number` is of this shard.
    pub(crate) fn holds(self, number: usize) -> bool {
        number % self.count == self.index
    }
}

/// The cores of a Slurm task, or `None` outside of one. The system may count all cores of the node.
pub(crate) fn cores(variable: impl Fn(&str) -> Option<String>) -> Option<usize> {
    variable("SLURM_CPUS_PER_TASK")?.parse().ok().filter(|&cores| cores > 0)
}

/// The folder of a shard in the sweep's output folder.
pub(crate) fn shard_folder(output: &Path, shard: Shard) -> PathBuf {
    output.join("shards").join(format!("{}-of-{}", shard.index + 1, shard.count))
}

/// A sweep as a Slurm job array, and a job that merges its shards.
pub(crate) struct JobArray {
    /// The command line of a task, without its shard.
    pub(crate) run: Vec<String>,
    /// The command line of the merge, without the shards' folders.
    pub(crate) merge: Vec<String>,
    /// Number of cells.
    pub(crate) cells: usize,
    /// Cells at a time in one task; a task gets as many cores.
    pub(crate) jobs: usize,
    /// Number of tasks.
    pub(crate) shards: usize,
}

/// Time of a cell in units of the limit of one process: at most one for the fit, and an assumed one
/// for all other stages together.
const LIMITS_PER_CELL: f64 = 2.0;

/// Memory of a task in units of its processes' limits.
const MEMORY_MARGIN: f64 = 1.1;

/// A word of a shell's command line.
fn quote(text: &str) -> String {
    format!("'{}'", text.replace('\'', "'\\''"))
}

/// A shell's command line.
fn command_line(command: &[String]) -> String {
    command.iter().map(|word| quote(word)).collect::<Vec<_>>().join(" ")
}

impl JobArray {
    /// A script for `bash`. It submits the array, and a job that merges when all tasks have ended.
    pub(crate) fn script(&self, sweep: &Sweep, output: &Path) -> String {
        let JobArray { cells, jobs, shards, .. } = self;
        let rounds = cells.div_ceil(*shards).div_ceil(*jobs);
        let seconds = rounds as f64 * sweep.limits.seconds * LIMITS_PER_CELL;
        let minutes = (seconds / 60.0).ceil().max(1.0);
        let memory = (*jobs as f64 * sweep.limits.mebibytes * MEMORY_MARGIN).ceil();
        let out = output.to_string_lossy();
        // Slurm expands % in the names of logs.
        let [root, out, logs] =
            [&crate::measure::workspace_root().to_string_lossy(), &out, &*out.replace('%', "%%")]
                .map(quote);
        // The number of shards is fixed here: if some tasks are submitted again, Slurm counts only
        // those.
        let shard = format!("--shard \"$SLURM_ARRAY_TASK_ID/{shards}\"");
        let run = quote(&format!("{} {shard}", command_line(&self.run)));
        let merge =
            quote(&format!("{} --merge {out}/shards/*-of-{shards}", command_line(&self.merge)));
        let title = sweep.title.split_whitespace().collect::<Vec<_>>().join(" ");
        format!(
            "#!/usr/bin/env bash\n\
             # {title}: {cells} cells in {shards} array tasks of {jobs} at a time, and a merge.\n\
             set -euo pipefail\n\
             # Jobs start where they are submitted, and build the binary there.\n\
             cd {root}\n\
             mkdir -p {out}/shards\n\
             array=$(sbatch --parsable --job-name=dsdf-ablate --array=1-{shards} \
             --cpus-per-task={jobs} --mem={memory}M \\\n  \
             --time={minutes} --requeue --open-mode=append --output={logs}/shards/%a.log \\\n  \
             --wrap={run})\n\
             sbatch --parsable --job-name=dsdf-merge --dependency=afterany:\"$array\" \
             --cpus-per-task=1 --mem=2G --time=30 \\\n  \
             --output={logs}/merge.log --wrap={merge}\n",
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_are_read_and_every_cell_is_in_one_shard() {
        let none = |_: &str| None;
        assert_eq!(Shard::read(None, none).unwrap(), None);
        assert_eq!(Shard::read(Some("2/4"), none).unwrap(), Some(Shard { index: 1, count: 4 }));
        for wrong in ["0/4", "5/4", "x", "1/0", "1"] {
            assert!(
                Shard::read(Some(wrong), none).unwrap_err().to_string().contains("I/N"),
                "{wrong}"
            );
        }
        let task = |name: &str| {
            let (_, value) = [
                ("SLURM_ARRAY_TASK_ID", "7"),
                ("SLURM_ARRAY_TASK_MIN", "5"),
                ("SLURM_ARRAY_TASK_COUNT", "4"),
            ]
            .into_iter()
            .find(|(known, _)| *known == name)?;
            Some(value.to_owned())
        };
        assert_eq!(Shard::read(None, task).unwrap(), Some(Shard { index: 2, count: 4 }));
        // An array with a step other than one has gaps: some shards would never run.
        let odd =
            |name: &str| task(name).map(|v| if name.ends_with("ID") { "9".into() } else { v });
        Shard::read(None, odd).unwrap_err();
        assert_eq!(cores(none), None);
        assert_eq!(cores(|name| (name == "SLURM_CPUS_PER_TASK").then(|| "3".to_owned())), Some(3));
        for cell in 0..17 {
            assert_eq!((0..4).filter(|&index| Shard { index, count: 4 }.holds(cell)).count(), 1);
        }
    }
}
