//! The workspace's crates: the packages that they reach, and the table of the documentation.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context, ensure};
use serde_json::Value;

use super::markdown::section;

/// The packages among `refused` that a package reaches by normal dependencies and by its own
/// development dependencies, with its usual features.
///
/// # Errors
/// If there is no such package.
pub(crate) fn reached(package: &str, refused: &[&str]) -> anyhow::Result<Vec<String>> {
    let arguments = [
        "tree",
        "--package",
        package,
        "--edges",
        "normal,dev",
        "--prefix",
        "none",
        "--format",
        "{p}",
    ];
    let output =
        sweep::measure::cargo_command(&arguments).output().context("cannot start cargo tree")?;
    let message = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "cargo tree --package {package}: {}", message.trim());
    Ok(named(&String::from_utf8_lossy(&output.stdout), refused))
}

/// The packages among `refused` that the output of `cargo tree` has.
fn named(tree: &str, refused: &[&str]) -> Vec<String> {
    let packages = tree.lines().filter_map(|line| line.split_whitespace().next());
    let found: BTreeSet<_> = packages.filter(|package| refused.contains(package)).collect();
    found.into_iter().map(str::to_owned).collect()
}

/// The folders of the workspace's members, relative to its root.
///
/// # Errors
/// If `cargo metadata` fails.
pub(crate) fn members() -> anyhow::Result<BTreeSet<String>> {
    Ok(manifests()?.into_keys().collect())
}

/// The folders of the members that depend on a package, also for their tests only.
///
/// # Errors
/// If `cargo metadata` fails.
pub(crate) fn dependents(package: &str) -> anyhow::Result<BTreeSet<String>> {
    let depends = |manifest: &Value| {
        let all = manifest["dependencies"].as_array().into_iter().flatten();
        all.into_iter().any(|dependency| dependency["name"] == package)
    };
    let all = manifests()?.into_iter().filter(|(_, manifest)| depends(manifest));
    Ok(all.map(|(folder, _)| folder).collect())
}

/// The normal dependencies of each member on other members, by the names of their folders.
///
/// # Errors
/// If `cargo metadata` fails.
pub(crate) fn dependencies() -> anyhow::Result<BTreeMap<String, BTreeSet<String>>> {
    let manifests = manifests()?;
    let package = |manifest: &Value| manifest["name"].as_str().unwrap_or_default().to_owned();
    let folders: BTreeMap<String, String> = manifests
        .iter()
        .map(|(folder, manifest)| (package(manifest), last(folder).to_owned()))
        .collect();
    let of = |manifest: &Value| {
        let all = manifest["dependencies"].as_array().into_iter().flatten();
        // The kind of a normal dependency is null.
        let normal = all.filter(|dependency| dependency["kind"].is_null());
        normal.filter_map(|dependency| folders.get(&package(dependency)).cloned()).collect()
    };
    Ok(manifests.iter().map(|(folder, manifest)| (last(folder).to_owned(), of(manifest))).collect())
}

/// The last name of a path.
fn last(folder: &str) -> &str {
    folder.rsplit('/').next().unwrap_or_default()
}

/// The manifests of the workspace's members, as JSON, by their folders relative to its root.
fn manifests() -> anyhow::Result<BTreeMap<String, Value>> {
    let arguments = ["metadata", "--no-deps", "--format-version", "1"];
    let output =
        sweep::measure::cargo_command(&arguments).output().context("cannot start cargo")?;
    ensure!(output.status.success(), "cargo metadata: {}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout)?;
    let root = metadata["workspace_root"].as_str().context("workspace_root")?;
    let packages = metadata["packages"].as_array().context("packages")?;
    let folder = |package: &Value| {
        let manifest = package["manifest_path"].as_str()?;
        let folder = manifest.strip_prefix(root)?.strip_suffix("Cargo.toml")?;
        Some(folder.trim_matches('/').to_owned())
    };
    let manifest =
        |package: &Value| Ok((folder(package).context("manifest_path")?, package.clone()));
    packages.iter().map(manifest).collect()
}

/// The first block of code below the heading "Crates" of a page is a picture of the layers: each
/// line is a row, with its name and then its crates. The findings are the dependencies that go from
/// a crate to a crate of a higher row, and the crates in `crates` that the picture lacks, has
/// twice, or does not know.
pub(crate) fn layers(
    page: &str,
    members: &BTreeSet<String>,
    dependencies: &BTreeMap<String, BTreeSet<String>>,
) -> Vec<String> {
    let Some(picture) = section(page, "Crates").and_then(|text| text.split("```").nth(1)) else {
        return vec!["no picture of the layers in the section \"## Crates\"".to_owned()];
    };
    let mut findings = Vec::new();
    // The row of each crate, counted from the top.
    let mut rows = BTreeMap::new();
    for (row, line) in picture.lines().filter(|line| !line.trim().is_empty()).enumerate() {
        for name in line.split_whitespace().skip(1).filter(|word| *word != "─") {
            if !dependencies.contains_key(name) {
                findings.push(format!("the picture of layers has `{name}`, which is no member"));
            } else if rows.insert(name, row).is_some() {
                findings.push(format!("the picture of layers has `{name}` twice"));
            }
        }
    }
    for name in members.iter().filter_map(|folder| folder.strip_prefix("crates/")) {
        if !rows.contains_key(name) {
            findings.push(format!("the picture of layers lacks `{name}`"));
        }
    }
    for (name, needed) in dependencies {
        for other in needed {
            if let (Some(row), Some(other_row)) = (rows.get(&**name), rows.get(&**other))
                && other_row < row
            {
                findings.push(format!("`{name}` depends on `{other}`, which is in a higher row"));
            }
        }
    }
    findings
}

/// The differences between the members and the tables below the heading "Crates" of a page. A row
/// stands for the crate, or the crates, whose folders are named in backticks in its first cell.
pub(crate) fn table(page: &str, members: &BTreeSet<String>) -> Vec<String> {
    let Some(section) = section(page, "Crates") else {
        return vec!["no section \"## Crates\"".to_owned()];
    };
    let name = |folder: &str| last(folder).to_owned();
    let members: BTreeSet<String> = members.iter().map(|folder| name(folder)).collect();
    let first_cells = section.lines().filter_map(|line| line.strip_prefix('|')?.split('|').next());
    let rows = first_cells.flat_map(|cell| cell.split('`').skip(1).step_by(2)).map(name);
    let mut seen = BTreeSet::new();
    let mut findings = Vec::new();
    for row in rows {
        if !members.contains(&row) {
            findings.push(format!("the table of crates has `{row}`, which is no member"));
        } else if !seen.insert(row.clone()) {
            findings.push(format!("the table of crates has `{row}` twice"));
        }
    }
    let missing = members.difference(&seen);
    findings.extend(missing.map(|name| format!("the table of crates lacks `{name}`")));
    findings
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refused_packages_are_found_in_a_tree() {
        let tree = "dsdf-render v0.1.0 (/here)\nglam v0.34.0\nsafetensors v0.8.0\nsafetensors v0.8.0 (*)\n";
        assert_eq!(named(tree, &["sdf-nn", "safetensors"]), ["safetensors"]);
        assert!(named(tree, &["sdf-nn"]).is_empty());
        assert!(reached("no-such-package", &[]).is_err());
        assert_eq!(reached("xtask", &["clap", "no-such-package"]).unwrap(), ["clap"]);
    }

    #[test]
    fn the_members_are_folders() {
        let members = members().unwrap();
        assert!(members.contains("xtask") && members.contains("crates/trace"), "{members:?}");
        let dependents = dependents("anyhow").unwrap();
        assert!(dependents.contains("xtask") && !dependents.contains("crates/trace"));
    }

    #[test]
    fn normal_dependencies_are_between_folders() {
        let dependencies = dependencies().unwrap();
        assert_eq!(dependencies["film"], BTreeSet::from(["files".to_owned()]));
        // `xtask` needs `tests` for its own tests only.
        assert!(!dependencies["xtask"].contains("tests"));
    }

    #[test]
    fn dependencies_go_to_the_same_row_or_to_a_lower_one() {
        let members = BTreeSet::from(["crates/film", "crates/trace", "xtask"].map(str::to_owned));
        let dependencies: BTreeMap<_, _> =
            [("film", vec!["trace"]), ("trace", vec![]), ("xtask", vec!["film"])]
                .map(|(name, to)| (name.to_owned(), to.into_iter().map(str::to_owned).collect()))
                .into();
        let found = |rows: &str| {
            let page = format!("# A\n\n## Crates\n\nText.\n\n```\n{rows}```\n\n## B\n");
            layers(&page, &members, &dependencies)
        };
        assert_eq!(found(" top  film\n low  trace\n"), [""; 0]);
        assert_eq!(found(" one  xtask ─ film ─ trace\n"), [""; 0]);
        let higher = "`film` depends on `trace`, which is in a higher row";
        assert_eq!(found(" top  trace\n low  film\n"), [higher]);
        let expected = [
            "the picture of layers has `warp`, which is no member",
            "the picture of layers has `film` twice",
            "the picture of layers lacks `trace`",
        ];
        assert_eq!(found(" top  warp ─ film\n low  film\n"), expected);
        assert_eq!(layers("# A\n", &members, &dependencies).len(), 1);
    }

    #[test]
    fn the_table_has_each_member_once() {
        let members = BTreeSet::from(["crates/trace", "crates/warp", "xtask"].map(str::to_owned));
        let page = |rows: &str| {
            format!("# A\n\n## Crates\n\n| crate | content |\n| --- | --- |\n{rows}\n## B\n| `z` |")
        };
        let whole =
            page("| [`trace`](../crates/trace) | `rays` |\n| `crates/warp`, `xtask` | x |\n");
        assert!(table(&whole, &members).is_empty(), "{:?}", table(&whole, &members));
        let wrong = page("| `trace` | x |\n| `trace` | x |\n| `film` | x |\n| `warp` | x |\n");
        let expected = [
            "the table of crates has `trace` twice",
            "the table of crates has `film`, which is no member",
            "the table of crates lacks `xtask`",
        ];
        assert_eq!(table(&wrong, &members), expected);
        assert_eq!(table("# A\n", &members).len(), 1);
    }
}
