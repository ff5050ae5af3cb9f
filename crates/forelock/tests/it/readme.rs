//! What the README shows is what there is.

use std::sync::atomic::AtomicBool;

use forelock::scene::Override;
use forelock::{Backend, RunOptions, Scene, simulate};

const README: &str = include_str!("../../../../README.md");

/// The first block of the README in `language`.
fn block(language: &str) -> &'static str {
    let rest = README.split_once(&format!("```{language}\n")).map_or("", |(_, rest)| rest);
    rest.split_once("```").map_or("", |(block, _)| block)
}

#[test]
fn the_scene_is_the_file() {
    assert_eq!(block("toml"), include_str!("../../../../scenes/bob-and-ball.toml"));
}

#[test]
fn the_summary_has_these_fields() -> Result<(), Box<dyn std::error::Error>> {
    let small = ["groom.strands=20", "time.frames=1", "body.sdf_cells=24", "output.picture=false"];
    let none = ["output.film=false", "output.contact_sheet=false", "output.report=false"];
    let sets: Result<Vec<_>, _> = small.iter().chain(&none).map(|set| Override::set(set)).collect();
    let folder = tempfile::tempdir()?;
    let options = RunOptions { out: folder.path().to_path_buf(), resume: false, backend: Backend::Cpu };
    let summary = simulate(&Scene::builtin(&sets?)?, &options, &mut |_| {}, &AtomicBool::new(false))?;
    let is: serde_json::Value = serde_json::to_value(&summary)?;
    let shown: serde_json::Value = serde_json::from_str(block("json"))?;
    let keys = |value: &serde_json::Value| -> Vec<String> {
        value.as_object().into_iter().flatten().map(|(key, _)| key.clone()).collect()
    };
    assert_eq!(keys(&shown), keys(&is));
    for key in ["ms_per_frame", "ms_per_stage"] {
        assert_eq!(keys(&shown[key]), keys(&is[key]), "{key}");
    }
    Ok(())
}
