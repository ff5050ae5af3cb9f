//! `help`: of commands, and the reference of scene files.

use crate::common::{Workplace, stdout};

#[test]
fn help_describes_commands_and_keys() {
    let place = Workplace::new();
    let help = |topic: &[&str]| {
        let output = place.run([&["help"], topic].concat());
        assert!(output.status.success() && output.stderr.is_empty(), "{topic:?}");
        stdout(&output)
    };
    assert!(help(&[]).contains("Usage: forelock"));
    assert_eq!(help(&["bench", "paper"]), stdout(&place.run(["bench", "paper", "--help"])));
    let key = help(&["scene", "solver.ams.k_edge"]);
    assert!(
        key.starts_with("solver.ams.k_edge\n") && key.contains("default 1e6; unit s⁻²; range 0 to 1e12"),
        "{key}"
    );
    // The last part of a key is enough, and the numbers of list entries do not matter.
    assert!(help(&["scene", "k_edge"]).contains("\nsolver.mass_spring.k_edge\n"));
    assert!(help(&["scene", "collider.0.motion.amplitude"]).starts_with("body.motion.amplitude\n"));
    let table = help(&["scene", "interaction"]);
    for name in ["interaction.kind\n", "interaction.grid.resolution\n", "interaction.contact.slip\n"] {
        assert!(table.contains(name), "{name} is not in {table}");
    }
    assert!(!table.contains("solver."));
    let (whole, page) = (help(&["scene"]), help(&["scene", "--markdown"]));
    assert!(whole.contains("wind.velocity\n") && whole.contains("edit.comb.points\n"));
    assert!(
        page.starts_with("# Scene reference\n") && page.contains("| `k_edge` | s⁻² | `1e6` | 0 to 1e12 |")
    );
}
