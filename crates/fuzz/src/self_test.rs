//! A reader with every fault, to test that the driver of the campaigns notices and survives them.

use std::path::Path;

use proptest::prelude::*;

use crate::case::Case;

/// A file that names a fault. Most are `none`.
pub(crate) fn cases() -> BoxedStrategy<Case> {
    let faults = prop_oneof![
        5 => Just("none"),
        1 => prop::sample::select(vec!["panic", "abort", "memory", "time", "lines"]),
    ];
    faults.prop_map(|fault| Case::default().file("fault", fault)).boxed()
}

/// Has the fault that the file names.
pub(crate) fn read(folder: &Path) -> anyhow::Result<()> {
    let fault = std::fs::read_to_string(folder.join("fault"))?;
    match fault.as_str() {
        "panic" => panic!("a fault on purpose"),
        "abort" => std::process::abort(),
        "memory" => {
            // Without the black box, the compiler leaves the memory out.
            let much = std::hint::black_box(vec![1u8; 1 << 40]);
            anyhow::ensure!(much.len() > 1, "no memory");
        }
        "time" => std::thread::sleep(std::time::Duration::from_secs(3600)),
        "lines" => anyhow::bail!("one line\nand another"),
        _ => {}
    }
    Ok(())
}
