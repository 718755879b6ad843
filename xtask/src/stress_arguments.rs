//! The arguments of `cargo xtask fuzz` and `cargo xtask soak`.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

/// Arguments of `cargo xtask fuzz`.
#[derive(Args)]
pub(crate) struct Fuzz {
    /// Minutes for each reader
    #[arg(long, default_value = "1", value_parser = minutes)]
    minutes: Duration,
    /// The only reader to run [default: all]
    #[arg(long)]
    reader: Option<String>,
    /// Seed of the files
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder for the files of the findings
    #[arg(short, long, default_value = "target/fuzz")]
    output: PathBuf,
}

impl Fuzz {
    pub(crate) fn run(self) -> anyhow::Result<()> {
        let Fuzz { minutes: time, reader, seed, output } = self;
        stress::fuzz::run(&stress::fuzz::Options { time, reader, seed, output })
    }
}

/// Arguments of `cargo xtask soak`.
#[derive(Args)]
pub(crate) struct Soak {
    /// Kills of a short fit, each at a random moment
    #[arg(long, default_value_t = 100)]
    kills: u32,
    /// Minutes of the long fit, whose memory must stay flat
    #[arg(long, default_value = "10", value_parser = minutes)]
    minutes: Duration,
    /// Seed of the moments
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The dsdf program [default: it is built]
    #[arg(long)]
    binary: Option<PathBuf>,
}

impl Soak {
    pub(crate) fn run(self) -> anyhow::Result<()> {
        let Soak { kills, minutes: time, seed, binary: program } = self;
        stress::soak::run(&stress::soak::Options { kills, time, seed, program })
    }
}

/// Parses a number of minutes.
fn minutes(text: &str) -> Result<Duration, String> {
    let seconds = text.parse::<f64>().ok().map(|minutes| 60.0 * minutes);
    let time = seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    time.ok_or_else(|| "expected a number of minutes, 0 or more".to_owned())
}
