//! Dense linear algebra for small systems.

/// A square matrix, row by row.
pub type Matrix = Vec<Vec<f64>>;

/// Solves A v = b by Gaussian elimination with partial pivoting.
pub fn solve(mut a: Matrix, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs())).unwrap();
        a.swap(k, pivot);
        b.swap(k, pivot);
        let (done, below) = a.split_at_mut(k + 1);
        for (row, i) in below.iter_mut().zip(k + 1..) {
            let factor = row[k] / done[k][k];
            for (x, y) in row[k..].iter_mut().zip(&done[k][k..]) {
                *x -= factor * y;
            }
            b[i] -= factor * b[k];
        }
    }
    for k in (0..n).rev() {
        let later: f64 = (k + 1..n).map(|j| a[k][j] * b[j]).sum();
        b[k] = (b[k] - later) / a[k][k];
    }
    b
}

#[test]
fn elimination_solves() {
    let a = vec![vec![0.0, 2.0, 1.0], vec![1.0, -1.0, 0.5], vec![3.0, 0.25, -2.0]];
    let expected = [1.0, -2.0, 0.5];
    let b = a.iter().map(|row| row.iter().zip(&expected).map(|(a, x)| a * x).sum()).collect();
    for (x, expected) in solve(a, b).iter().zip(&expected) {
        assert!((x - expected).abs() < 1e-15);
    }
}
