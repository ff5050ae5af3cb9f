//! Reading golden files, and comparing with them (`tests/golden/README.md`).

#![expect(clippy::unwrap_used, reason = "a test fails where its file is not as expected")]

use serde_json::Value;

/// A golden file by name.
pub fn load(name: &str) -> Value {
    let path = format!("{}/tests/golden/{name}.json", env!("CARGO_MANIFEST_DIR"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// All numbers of an array of any depth, in order.
pub fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        other => vec![other.as_f64().unwrap()],
    }
}

/// All vectors of an array of any depth, in order.
pub fn vectors(value: &Value) -> Vec<[f64; 3]> {
    numbers(value).chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect()
}

/// The largest difference, over the largest number of `expected`.
pub fn error(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let largest = expected.iter().fold(0.0f64, |a, b| a.max(b.abs()));
    let differences = found.iter().zip(expected).map(|(a, b)| (a - b).abs());
    // A number that is NaN has an infinite error.
    differences.fold(0.0f64, |a, b| if b.is_nan() { f64::INFINITY } else { a.max(b) }) / largest
}
