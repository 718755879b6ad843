//! The groups of options in the help of commands with many. (`fit` has its own.)

/// A heading, whether `-h` shows its options or only `--help`, and their names.
type Group = (&'static str, bool, &'static [&'static str]);

/// The commands and their groups.
const GROUPS: [(&str, &[Group]); 4] = [
    (
        "render",
        &[
            ("Scene files", true, &["seed", "precision", "relaxation"]),
            ("Runs", true, &["views", "size"]),
        ],
    ),
    (
        "gradient",
        &[
            ("Sampling", true, &["preset", "spp", "edge_samples", "filter", "seed", "precision"]),
            ("Warps", false, &["steps", "top_k", "gamma", "lambda_d", "epsilon"]),
            ("Tracing", false, &["relaxation", "hit_tolerance"]),
        ],
    ),
    (
        "mesh",
        &[
            ("Cuts", true, &["cull", "mask_margin", "crop", "above"]),
            ("Colours, size and direction", true, &["color", "texture", "up", "scale", "decimate"]),
        ],
    ),
    (
        "eval",
        &[
            ("Shape", true, &["mesh", "points", "point_spacing", "point_cap", "resolution"]),
            ("Cuts", true, &["cull", "mask_margin"]),
            ("Views", true, &["views", "pictures", "spp"]),
        ],
    ),
];

/// Sorts the options of a command into its groups.
pub(super) fn grouped(command: clap::Command) -> clap::Command {
    let groups = GROUPS.iter().find(|(name, _)| *name == command.get_name());
    let groups = groups.map_or(&[][..], |(_, groups)| groups);
    command.mut_args(|arg| {
        let has_arg = |(_, _, names): &&Group| names.contains(&arg.get_id().as_str());
        match groups.iter().find(has_arg) {
            Some((heading, is_short, _)) => arg.help_heading(*heading).hide_short_help(!is_short),
            None => arg,
        }
    })
}
