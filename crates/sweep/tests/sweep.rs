//! Sweep files: their cells, and the refusals of wrong ones.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use files::InputError;
use sweep::report::{SHIPPED, Sweep};

fn sweep(text: &str) -> Result<Sweep, InputError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.toml");
    std::fs::write(&path, text).unwrap();
    Sweep::load(&path.to_string_lossy()).map(|(sweep, _)| sweep)
}

const GOOD: &str = r#"title = "t"
iterations = 5
seeds = [1, 2]
[parameters]
gamma = [3.0, 6.0]
top_k = [4, 7, 9]
[fixed]
estimator = "paper"
masks = "use"
[[data]]
name = "a"
scene = "a.json"
"#;

#[test]
fn cells_are_all_combinations_for_every_seed() {
    let sweep = sweep(GOOD).unwrap();
    let cells = sweep.cells();
    assert_eq!(cells.len(), 12);
    assert_eq!(cells[1].name, "a.gamma=3.0.top_k=7.seed=1");
    let flags = sweep.flags(&cells[11]).join(" ");
    assert_eq!(
        flags,
        "--estimator=paper --masks=use --gamma=6.0 --top-k=9 --seed=2 --iterations=5"
    );
    assert_eq!(sweep.axes(), ("gamma".to_owned(), Some("top_k".to_owned())));
    let mut names: Vec<&String> = cells.iter().map(|c| &c.name).collect();
    names.dedup();
    assert_eq!(names.len(), 12);
}

#[test]
fn a_value_of_settings_stands_for_options() {
    let settings = "weights = [\"mild\", \"sharp\"]\n[settings.weights]\nmild = {}\n\
                    sharp = { gamma = 6.0, clip = inf }\n[fixed]";
    let text = GOOD.replace("gamma = [3.0, 6.0]\n", "").replace("[fixed]", settings);
    let sweep = sweep(&text).unwrap();
    let cells = sweep.cells();
    assert_eq!(cells.len(), 12);
    assert_eq!(cells[1].name, "a.top_k=4.weights=sharp.seed=1");
    let flags = |cell| sweep.flags(cell).join(" ");
    let fixed = "--estimator=paper --masks=use --top-k=4";
    assert_eq!(flags(&cells[0]), format!("{fixed} --seed=1 --iterations=5"));
    assert_eq!(flags(&cells[1]), format!("{fixed} --clip=inf --gamma=6.0 --seed=1 --iterations=5"));
    assert_eq!(sweep.setting(&cells[0], "gamma"), None);
    assert_eq!(sweep.setting(&cells[1], "gamma").as_deref(), Some("6.0"));
}

#[test]
fn wrong_sweep_files_are_refused_in_one_line() {
    for (from, to, field, expected) in [
        ("title", "titel", "line 1", "a sweep"),
        ("seeds = [1, 2]", &format!("seeds = {:?}", [7; 2000]), "parameters", "at most 10000"),
        ("gamma = [3.0, 6.0]", "gamma = []", "parameters.gamma", "one value or more"),
        ("gamma = [3.0, 6.0]", "gamma = 3", "parameters.gamma", "a list of values"),
        ("gamma = [3.0, 6.0]", "gamma = [3.0, 3.0]", "parameters.gamma", "different values"),
        ("gamma = [3.0, 6.0]", "gamma = [[1]]", "parameters.gamma", "numbers"),
        ("[fixed]", "[settings.a]\n4 = {}\n[fixed]", "settings.a: found a", "a key of parameters"),
        ("[fixed]", "[settings.top_k]\n4 = {}\n[fixed]", "found nothing for 7", "each value"),
        (
            "[fixed]",
            "[settings.top_k]\n4 = {}\n5 = {}\n7 = {}\n9 = {}\n[fixed]",
            "settings.top_k: found 5",
            "one of 4, 7, 9",
        ),
        ("seeds = [1, 2]", "seeds = []", "seeds", "one or more"),
        ("seeds = [1, 2]", "seeds = [1, 1]", "seeds", "different seeds"),
        ("gamma = [3.0, 6.0]", "gamma = [3.0, 3]", "parameters.gamma", "different values"),
        ("[fixed]", "[limits]\nseconds = nan\n[fixed]", "limits.seconds", "above 0"),
        (
            "iterations = 5",
            "iterations = 5\nrows = \"gamma\"\ncolumns = \"gamma\"",
            "columns",
            "another one",
        ),
        ("[fixed]", "[gradient]\nruns = 1\n[fixed]", "gradient.runs: found 1", "2 or more"),
        ("[fixed]", "[gradient]\nspp = 0\n[fixed]", "gradient.spp: found 0", "1 or more"),
        ("iterations = 5", "", "iterations", "one of them"),
        (
            "iterations = 5",
            "iterations = 5\nmesh_resolution = 4",
            "mesh_resolution: found 4",
            "8 to 2048",
        ),
        ("iterations = 5", "iterations = 5\ntime = \"3s\"", "iterations", "one of them"),
        ("iterations = 5", "iterations = 5\nrows = \"k\"", "rows", "a key of parameters"),
        ("name = \"a\"", "name = \"a/b\"", "data.name", "letters"),
        ("scene = \"a.json\"", "", "data.a", "one of them"),
        ("iterations = 5", "iterations = 5\nmetrics = [\"speed\"]", "metrics", "chamfer"),
    ] {
        let message = sweep(&GOOD.replace(from, to)).unwrap_err().to_string();
        assert!(
            message.contains(field) && message.contains(expected) && !message.contains('\n'),
            "{to}: {message}"
        );
    }
    let claim =
        "[[claim]]\ntext = \"c\"\nkind = \"worse\"\nparameter = \"gamma\"\nvalues = [6.0]\n";
    let message = sweep(&format!("{GOOD}{claim}")).unwrap_err().to_string();
    assert!(message.contains("than"), "{message}");
    sweep(&format!("{GOOD}{claim}than = 3.0\n")).unwrap();
    let message = sweep(&format!("{GOOD}{claim}than = 4.0\n")).unwrap_err().to_string();
    assert!(message.contains("a value of the grid"), "{message}");
    assert!(sweep("").unwrap_err().to_string().contains("expected"));
}

#[test]
fn shipped_sweeps_are_read_and_have_their_number_of_cells() {
    let cells = |name: &str| Sweep::load(name).unwrap().0.cells().len();
    assert_eq!(SHIPPED.map(cells), [96, 42, 96, 150, 48, 36, 12, 66, 4]);
    let folder = sweep::measure::workspace_root().join("xtask/sweeps");
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let sweeps = files.filter(|path| path.extension().is_some_and(|e| e == "toml"));
    for path in sweeps {
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        assert!(SHIPPED.contains(&name.as_str()), "{name} is not shipped");
    }
    assert!(Sweep::load("nothing").unwrap_err().to_string().contains("k-gamma"));
}
