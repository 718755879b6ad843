//! Sweeps on clusters: shards, and the script of a job array.

use std::path::Path;

use super::refusal::Refusal;
use super::sweep::Sweep;

/// Shard `index` of `count`, from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shard {
    pub(super) index: usize,
    pub(super) count: usize,
}

impl Shard {
    /// Reads `I/N` with I from 1 to N, or nothing, with the array task that `variable` tells of.
    pub(super) fn read(
        argument: Option<&str>,
        variable: impl Fn(&str) -> Option<String>,
    ) -> Result<Option<Shard>, Refusal> {
        let refuse = |field: &str, found: &str, expected: &str| {
            Err(Refusal::new(Path::new("arguments"), field, found, expected))
        };
        if let Some(text) = argument {
            let numbers =
                text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
            return match numbers {
                Some((i, count)) if (1..=count).contains(&i) => {
                    Ok(Some(Shard { index: i - 1, count }))
                }
                _ => refuse("--shard", text, "I/N with I from 1 to N"),
            };
        }
        let Some(task) = variable("SLURM_ARRAY_TASK_ID") else { return Ok(None) };
        let number = |name: &str| variable(name).and_then(|v| v.parse::<usize>().ok());
        let (first, count) = (number("SLURM_ARRAY_TASK_MIN"), number("SLURM_ARRAY_TASK_COUNT"));
        match (task.parse::<usize>(), first, count) {
            (Ok(task), Some(first), Some(count)) if task >= first && task - first < count => {
                Ok(Some(Shard { index: task - first, count }))
            }
            _ => refuse("SLURM_ARRAY_TASK_ID", &task, "an array of consecutive tasks"),
        }
    }

    /// Whether cell `number` is of this shard.
    pub(super) fn holds(self, number: usize) -> bool {
        number % self.count == self.index
    }
}

/// The cores that a task was given, where it is one: a node may not say, and offer all it has.
pub(super) fn cores(variable: impl Fn(&str) -> Option<String>) -> Option<usize> {
    variable("SLURM_CPUS_PER_TASK")?.parse().ok().filter(|&cores| cores > 0)
}

/// The folder of a shard in that of its sweep.
pub(super) fn folder(output: &Path, shard: Shard) -> std::path::PathBuf {
    output.join("shards").join(format!("{}-of-{}", shard.index + 1, shard.count))
}

/// A sweep as a job array and a merge.
pub(super) struct Job {
    /// The command of a task, but for its shard.
    pub(super) run: Vec<String>,
    /// The command of the merge, but for its folders.
    pub(super) merge: Vec<String>,
    /// Cells in all.
    pub(super) cells: usize,
    /// Cells at a time in a task.
    pub(super) jobs: usize,
    /// Tasks.
    pub(super) shards: usize,
}

/// A word of a shell's command line.
fn quote(text: &str) -> String {
    format!("'{}'", text.replace('\'', "'\\''"))
}

impl Job {
    /// A script for `bash`: it submits the array, and a job that merges when all of it is done.
    pub(super) fn script(&self, sweep: &Sweep, output: &Path) -> String {
        let Job { cells, jobs, shards, .. } = self;
        // Fits have the limit each; what is measured of them takes less again.
        let rounds = cells.div_ceil(*shards).div_ceil(*jobs);
        let minutes = (rounds as f64 * sweep.limits.seconds * 2.0 / 60.0).ceil().max(1.0);
        let memory = (*jobs as f64 * sweep.limits.mebibytes * 1.1).ceil();
        let out = output.to_string_lossy();
        // Slurm has its own use for % in the names of logs.
        let [root, out, logs] =
            [&measure::dsdf::root().to_string_lossy(), &out, &*out.replace('%', "%%")].map(quote);
        let words = |command: &[String]| {
            command.iter().map(|word| quote(word)).collect::<Vec<_>>().join(" ")
        };
        // The number of tasks is said: an array of some tasks again would count only those.
        let run = format!("{} --shard \"$SLURM_ARRAY_TASK_ID/{shards}\"", words(&self.run));
        let merge = format!("{} --merge {out}/shards/*-of-{shards}", words(&self.merge));
        let title: Vec<&str> = sweep.title.split_whitespace().collect();
        format!(
            "#!/usr/bin/env bash\n\
             # {}: {cells} cells in {shards} array tasks of {jobs} at a time, and a merge.\n\
             set -euo pipefail\n\
             # Jobs start where they are submitted, and build the binary there.\n\
             cd {root}\n\
             mkdir -p {out}/shards\n\
             array=$(sbatch --parsable --job-name=dsdf-ablate --array=1-{shards} --cpus-per-task={jobs} --mem={memory}M \\\n  \
             --time={minutes} --requeue --open-mode=append --output={logs}/shards/%a.log \\\n  \
             --wrap={})\n\
             sbatch --parsable --job-name=dsdf-merge --dependency=afterany:\"$array\" --cpus-per-task=1 --mem=2G --time=30 \\\n  \
             --output={logs}/merge.log --wrap={}\n",
            title.join(" "),
            quote(&run),
            quote(&merge),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_are_read_and_share_all_cells() {
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
        // An array of other steps than one has gaps that no shard would fill.
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
