//! `forelock bench`: the paper's table and figures, tiny.

use crate::common::{Workplace, json, stderr};

#[test]
fn table_1_is_json_alone_and_a_page() {
    let place = Workplace::new();
    let small = ["bench", "paper", "--share", "0.002", "--frames", "2", "--warm-up", "0"];
    let output = place.run(small.iter().copied().chain(["--json", "--out", "bench"]));
    let table = json(&output);
    let rows = table["rows"].as_array().unwrap_or_else(|| panic!("{}", stderr(&output)));
    assert_eq!(rows.len(), 12);
    for figure in ["1", "4", "5", "6", "7", "8", "9", "10", "11"] {
        assert!(rows.iter().any(|row| row["figure"] == figure), "figure {figure} is missing");
    }
    for row in rows {
        // Without the repository beside it the command has no real groom.
        assert_eq!(row["skipped"].is_string(), row["scene"] == "grooming", "{row}");
        if row["skipped"].is_null() {
            assert!(row["ms_per_frame"]["median"].as_f64().is_some_and(|ms| ms > 0.0), "{row}");
            assert!(row["ms_per_stage"]["solve_strands"].is_number(), "{row}");
        }
    }
    for name in ["ams-table1.md", "ams-table1.json", "ams-table1.html", "ams-table1-stages.svg"] {
        let text = std::fs::read_to_string(place.path("bench").join(name)).unwrap_or_default();
        assert!(text.contains("Hand Interaction"), "{name}");
    }
}

#[test]
fn a_figure_leaves_its_plots() {
    let place = Workplace::new();
    let output =
        place.run(["bench", "paper", "--figure", "9", "--share", "0.02", "--out", "bench", "--json"]);
    let study = json(&output);
    assert_eq!(study["tables"][0]["rows"].as_array().map(Vec::len), Some(6), "{}", stderr(&output));
    for name in ["ams-figure-9.md", "ams-figure-9.html", "ams-figure-9-offset.svg"] {
        assert!(place.path("bench").join(name).is_file(), "{name}");
    }
}

#[test]
fn scaling_is_a_row_a_count_beside_the_peaks() {
    let place = Workplace::new();
    let small = ["bench", "scaling", "--most", "1000", "--frames", "2", "--out", "bench", "--json"];
    let table = json(&place.run(small));
    assert_eq!(table["rows"].as_array().map(Vec::len), Some(1), "{table}");
    let row = &table["rows"][0];
    assert_eq!((row["strands"].as_u64(), row["particles"].as_u64()), (Some(1000), Some(25_000)));
    let stages = row["ms_per_stage"].to_string();
    assert!(stages.contains("solve_strands") && stages.contains("solve_pressure"), "{stages}");
    // No work is done faster than the machine can.
    let [rate, peak] = [&row["solve_operations_per_sec"], &table["peak_operations_per_sec"]]
        .map(|rate| rate.as_f64().unwrap_or_default());
    assert!(rate > 0.01 * peak && rate < peak, "{rate} of {peak}");
    let page = std::fs::read_to_string(place.path("bench/scaling-cpu.md")).unwrap_or_default();
    assert!(page.contains("| 1,000 × 25 |") && page.contains("Measured peaks"), "{page}");
    let apart = json(&place.run(small.iter().copied().chain(["--apart"])));
    assert!(!apart["rows"].to_string().contains("solve_pressure"), "{apart}");
}
