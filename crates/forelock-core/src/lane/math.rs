//! Small vectors and matrices over SIMD lanes.

use super::{Lane, Row};
use glam::{DMat3, DQuat, DVec3};
use std::ops::{Add, AddAssign, Mul, Neg, Sub, SubAssign};

/// One vector for each lane.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct V3<L>(pub [L; 3]);

impl<L: Lane> Add for V3<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self([self.0[0] + b.0[0], self.0[1] + b.0[1], self.0[2] + b.0[2]])
    }
}

impl<L: Lane> Sub for V3<L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self([self.0[0] - b.0[0], self.0[1] - b.0[1], self.0[2] - b.0[2]])
    }
}

impl<L: Lane> Neg for V3<L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self([-self.0[0], -self.0[1], -self.0[2]])
    }
}

impl<L: Lane> AddAssign for V3<L> {
    #[inline(always)]
    fn add_assign(&mut self, b: Self) {
        *self = *self + b;
    }
}

impl<L: Lane> SubAssign for V3<L> {
    #[inline(always)]
    fn sub_assign(&mut self, b: Self) {
        *self = *self - b;
    }
}

impl<L: Lane> V3<L> {
    /// The zero vector in every lane.
    #[inline(always)]
    pub fn zero() -> Self {
        Self([L::zero(); 3])
    }

    /// The same vector in every lane.
    #[inline(always)]
    pub fn splat(v: DVec3) -> Self {
        Self([L::from_f64(v.x), L::from_f64(v.y), L::from_f64(v.z)])
    }

    /// Reads lanes `first..` of the three rows of `particle`.
    #[inline(always)]
    pub fn load(rows: &[Row<L::Scalar>], particle: usize, first: usize) -> Self {
        let rows = &rows[3 * particle..3 * particle + 3];
        Self([L::load(&rows[0], first), L::load(&rows[1], first), L::load(&rows[2], first)])
    }

    /// Writes lanes `first..` of the three rows of `particle`.
    #[inline(always)]
    pub fn store(self, rows: &mut [Row<L::Scalar>], particle: usize, first: usize) {
        let rows = &mut rows[3 * particle..3 * particle + 3];
        self.0[0].store(&mut rows[0], first);
        self.0[1].store(&mut rows[1], first);
        self.0[2].store(&mut rows[2], first);
    }

    /// The vector of one lane.
    #[inline(always)]
    pub fn get(self, lane: usize) -> [L::Scalar; 3] {
        [self.0[0].get(lane), self.0[1].get(lane), self.0[2].get(lane)]
    }

    /// Sets the vector of one lane.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, v: [L::Scalar; 3]) {
        self.0[0].set(lane, v[0]);
        self.0[1].set(lane, v[1]);
        self.0[2].set(lane, v[2]);
    }

    /// `yes` where the mask holds, `no` elsewhere.
    #[inline(always)]
    pub fn select(mask: L::Mask, yes: Self, no: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (yes.0, no.0);
        Self([L::select(mask, a, x), L::select(mask, b, y), L::select(mask, c, z)])
    }

    /// `self · b`.
    #[inline(always)]
    pub fn dot(self, b: Self) -> L {
        self.0[2].mul_add(b.0[2], self.0[1].mul_add(b.0[1], self.0[0] * b.0[0]))
    }

    /// `self × b`.
    #[inline(always)]
    pub fn cross(self, b: Self) -> Self {
        let [ax, ay, az] = self.0;
        let [bx, by, bz] = b.0;
        Self([ay.mul_add(bz, -(az * by)), az.mul_add(bx, -(ax * bz)), ax.mul_add(by, -(ay * bx))])
    }

    /// `self · a`.
    #[inline(always)]
    pub fn scale(self, a: L) -> Self {
        Self([self.0[0] * a, self.0[1] * a, self.0[2] * a])
    }

    /// `self + a b`.
    #[inline(always)]
    pub fn add_scaled(self, a: L, b: Self) -> Self {
        Self([a.mul_add(b.0[0], self.0[0]), a.mul_add(b.0[1], self.0[1]), a.mul_add(b.0[2], self.0[2])])
    }
}

/// One symmetric 3×3 matrix for each lane: xx, xy, xz, yy, yz, zz.
#[derive(Clone, Copy, Debug)]
pub struct Sym3<L>(pub [L; 6]);

impl<L: Lane> Sym3<L> {
    /// The zero matrix in every lane.
    #[inline(always)]
    pub fn zero() -> Self {
        Self([L::zero(); 6])
    }

    /// `self · a`.
    #[inline(always)]
    pub fn scale(&self, a: L) -> Self {
        let [xx, xy, xz, yy, yz, zz] = self.0;
        Self([xx * a, xy * a, xz * a, yy * a, yz * a, zz * a])
    }

    /// `a v vᵀ + b I`.
    #[inline(always)]
    pub fn outer_plus_identity(a: L, v: V3<L>, b: L) -> Self {
        let [x, y, z] = v.0;
        let (ax, ay, az) = (a * x, a * y, a * z);
        Self([ax.mul_add(x, b), ax * y, ax * z, ay.mul_add(y, b), ay * z, az.mul_add(z, b)])
    }

    /// `self + a I`.
    #[inline(always)]
    pub fn add_identity(mut self, a: L) -> Self {
        self.0[0] += a;
        self.0[3] += a;
        self.0[5] += a;
        self
    }

    /// `self v`.
    #[inline(always)]
    pub fn mul(&self, v: V3<L>) -> V3<L> {
        let [xx, xy, xz, yy, yz, zz] = self.0;
        let [x, y, z] = v.0;
        V3([
            xz.mul_add(z, xy.mul_add(y, xx * x)),
            yz.mul_add(z, yy.mul_add(y, xy * x)),
            zz.mul_add(z, yz.mul_add(y, xz * x)),
        ])
    }

    /// The inverse of a positive definite matrix from its LDLᵀ factors, with pivots clamped to at
    /// least `floor`. The adjugate formula suffers from cancellation and fails in float32 at a
    /// third of the stiffness.
    #[inline(always)]
    pub fn inverse(&self, floor: L) -> Self {
        let [xx, xy, xz, yy, yz, zz] = self.0;
        let i0 = L::one() / xx.max(floor);
        let (l10, l20) = (xy * i0, xz * i0);
        let i1 = L::one() / l10.neg_mul_add(xy, yy).max(floor);
        let t = l20.neg_mul_add(xy, yz);
        let l21 = t * i1;
        let i2 = L::one() / l21.neg_mul_add(t, l20.neg_mul_add(xz, zz)).max(floor);
        let m20 = l10.mul_add(l21, -l20);
        let (n20, n21) = (m20 * i2, -(l21 * i2));
        let n10 = l10 * i1;
        Self([
            m20.mul_add(n20, l10.mul_add(n10, i0)),
            m20.mul_add(n21, -n10),
            n20,
            l21.neg_mul_add(n21, i1),
            n21,
            i2,
        ])
    }
}

impl<L: Lane> AddAssign for Sym3<L> {
    #[inline(always)]
    fn add_assign(&mut self, b: Self) {
        for k in 0..6 {
            self.0[k] += b.0[k];
        }
    }
}

/// One 3×3 matrix for each lane, row by row.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct Mat3<L>(pub [[L; 3]; 3]);

impl<L: Lane> From<Sym3<L>> for Mat3<L> {
    #[inline(always)]
    fn from(s: Sym3<L>) -> Self {
        let [xx, xy, xz, yy, yz, zz] = s.0;
        Self([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    }
}

impl<L: Lane> Mat3<L> {
    /// The zero matrix in every lane.
    #[inline(always)]
    pub fn zero() -> Self {
        Self([[L::zero(); 3]; 3])
    }

    /// The same matrix in every lane.
    #[inline(always)]
    pub fn splat(m: DMat3) -> Self {
        Self([V3::splat(m.row(0)).0, V3::splat(m.row(1)).0, V3::splat(m.row(2)).0])
    }

    /// `self v`.
    #[inline(always)]
    pub fn mul(&self, v: V3<L>) -> V3<L> {
        V3([V3(self.0[0]).dot(v), V3(self.0[1]).dot(v), V3(self.0[2]).dot(v)])
    }

    /// `selfᵀ v`.
    #[inline(always)]
    pub fn mul_transposed(&self, v: V3<L>) -> V3<L> {
        V3::zero().add_transposed(self, v)
    }

    /// `self S` for a symmetric matrix S.
    #[inline(always)]
    pub fn mul_sym(&self, s: &Sym3<L>) -> Self {
        Self([s.mul(V3(self.0[0])).0, s.mul(V3(self.0[1])).0, s.mul(V3(self.0[2])).0])
    }

    /// `self + A Bᵀ`.
    #[inline(always)]
    pub fn add_mul_transposed(mut self, a: &Self, b: &Self) -> Self {
        for r in 0..3 {
            for c in 0..3 {
                for k in 0..3 {
                    self.0[r][c] = a.0[r][k].mul_add(b.0[c][k], self.0[r][c]);
                }
            }
        }
        self
    }
}

impl<L: Lane> V3<L> {
    /// `self + A v`.
    #[inline(always)]
    pub fn add_mul(mut self, a: &Mat3<L>, v: Self) -> Self {
        for r in 0..3 {
            for k in 0..3 {
                self.0[r] = a.0[r][k].mul_add(v.0[k], self.0[r]);
            }
        }
        self
    }

    /// `self + Aᵀ v`.
    #[inline(always)]
    pub fn add_transposed(mut self, a: &Mat3<L>, v: Self) -> Self {
        for k in 0..3 {
            for c in 0..3 {
                self.0[c] = a.0[k][c].mul_add(v.0[k], self.0[c]);
            }
        }
        self
    }
}

impl<L: Lane> Sym3<L> {
    /// `self − A Bᵀ` for a product that is known to be symmetric.
    #[inline(always)]
    pub fn sub_mul_transposed(mut self, a: &Mat3<L>, b: &Mat3<L>) -> Self {
        let places = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
        for (k, (r, c)) in places.into_iter().enumerate() {
            for m in 0..3 {
                self.0[k] = a.0[r][m].neg_mul_add(b.0[c][m], self.0[k]);
            }
        }
        self
    }
}

/// One quaternion for each lane: its vector part, then its scalar part.
#[derive(Clone, Copy, Debug)]
pub struct Quat<L> {
    /// x, y, z.
    pub v: V3<L>,
    /// w.
    pub w: L,
}

impl<L: Lane> Mul for Quat<L> {
    type Output = Self;
    /// The Hamilton product.
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        let v = b.v.scale(self.w).add_scaled(b.w, self.v) + self.v.cross(b.v);
        Self { v, w: self.w.mul_add(b.w, -self.v.dot(b.v)) }
    }
}

impl<L: Lane> Add for Quat<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self { v: self.v + b.v, w: self.w + b.w }
    }
}

impl<L: Lane> Quat<L> {
    /// The same quaternion in every lane.
    #[inline(always)]
    pub fn splat(q: DQuat) -> Self {
        Self { v: V3::splat(DVec3::new(q.x, q.y, q.z)), w: L::from_f64(q.w) }
    }

    /// Zero in every lane.
    #[inline(always)]
    pub fn zero() -> Self {
        Self::pure(V3::zero())
    }

    /// A quaternion whose scalar part is zero.
    #[inline(always)]
    pub fn pure(v: V3<L>) -> Self {
        Self { v, w: L::zero() }
    }

    /// Reads lanes `first..` of four rows: x, y, z, w.
    #[inline(always)]
    pub fn load(rows: &[Row<L::Scalar>], first: usize) -> Self {
        Self { v: V3::load(rows, 0, first), w: L::load(&rows[3], first) }
    }

    /// Writes lanes `first..` of four rows: x, y, z, w.
    #[inline(always)]
    pub fn store(self, rows: &mut [Row<L::Scalar>], first: usize) {
        self.v.store(rows, 0, first);
        self.w.store(&mut rows[3], first);
    }

    /// The conjugate, which is the inverse of a unit quaternion.
    #[inline(always)]
    pub fn conjugate(self) -> Self {
        Self { v: -self.v, w: self.w }
    }

    /// `self · a`.
    #[inline(always)]
    pub fn scale(self, a: L) -> Self {
        Self { v: self.v.scale(a), w: self.w * a }
    }

    /// The dot product of all four components.
    #[inline(always)]
    pub fn dot(self, b: Self) -> L {
        self.w.mul_add(b.w, self.v.dot(b.v))
    }

    /// `v` rotated by a unit quaternion.
    #[inline(always)]
    pub fn rotate(self, v: V3<L>) -> V3<L> {
        let twice = self.v.cross(v).scale(L::from_f64(2.0));
        v.add_scaled(self.w, twice) + self.v.cross(twice)
    }

    /// The shortest rotation from the unit vector `a` to the unit vector `b`; of opposite vectors,
    /// half a turn about an axis perpendicular to both.
    #[inline(always)]
    pub fn arc(a: V3<L>, b: V3<L>) -> Self {
        let n = L::from_f64(2.0).mul_add(a.dot(b), L::from_f64(2.0)).max(L::zero()).sqrt();
        let turned = n.lt(L::from_f64(1e-4));
        let inverse = L::one() / n.max(L::from_f64(1e-4));
        let [x, y, z] = a.0;
        let is_along_x = L::from_f64(0.5).lt(x * x);
        let axis = V3::select(is_along_x, V3([-y, x, L::zero()]), V3([L::zero(), -z, y]));
        let axis = axis.scale(L::one() / axis.dot(axis).sqrt());
        Self {
            v: V3::select(turned, axis, a.cross(b).scale(inverse)),
            w: L::select(turned, L::zero(), n * L::from_f64(0.5)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quaternions_agree_with_glam() {
        let (a, b) =
            (DQuat::from_rotation_x(0.7), DQuat::from_rotation_z(-1.9) * DQuat::from_rotation_y(0.4));
        let of = |q: Quat<f64>| DQuat::from_xyzw(q.v.0[0], q.v.0[1], q.v.0[2], q.w);
        let near = |q: Quat<f64>, other: DQuat| (of(q) - other).length() < 1e-15;
        let (qa, qb) = (Quat::<f64>::splat(a), Quat::splat(b));
        assert!(near(qa * qb, a * b) && near(qa.conjugate(), a.inverse()));
        let v = DVec3::new(0.3, -0.6, 2.0);
        assert!((DVec3::from_array(qb.rotate(V3::splat(v)).0) - b * v).length() < 1e-14);
        let ends = [DVec3::new(1.0, 2.0, -0.5).normalize(), DVec3::new(-0.2, 0.9, 1.0).normalize()];
        let [from, to] = ends.map(V3::<f64>::splat);
        assert!(near(Quat::arc(from, to), DQuat::from_rotation_arc(ends[0], ends[1])));
        for axis in [DVec3::X, DVec3::Y, ends[0]] {
            let half_turn = of(Quat::<f64>::arc(V3::splat(axis), V3::splat(-axis)));
            assert!((half_turn * axis + axis).length() < 1e-14 && (half_turn.length() - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn a_matrix_times_its_inverse_is_the_identity() {
        let s = Sym3([4.0f64, 1.0, -0.5, 3.0, 0.7, 2.0]);
        let inverse = s.inverse(1e-3);
        for axis in 0..3 {
            let mut e = [0.0; 3];
            e[axis] = 1.0;
            let back = s.mul(inverse.mul(V3(e))).0;
            for k in 0..3 {
                assert!((back[k] - e[k]).abs() < 1e-15, "{back:?}");
            }
        }
    }

    #[test]
    fn products_agree_with_glam() {
        let m = DMat3::from_cols_array(&[1.0, 2.0, 3.0, -4.0, 5.0, 0.5, 0.25, 8.0, -9.0]);
        let v = DVec3::new(0.3, -0.6, 2.0);
        assert_eq!(Mat3::<f64>::splat(m).mul(V3::splat(v)).0, (m * v).to_array());
        let t = Mat3::<f64>::splat(m).mul_transposed(V3::splat(v));
        assert!((DVec3::from_array(t.0) - m.transpose() * v).length() < 1e-14);
        assert_eq!(V3::<f64>::splat(v).cross(V3::splat(DVec3::X)).0, v.cross(DVec3::X).to_array());
    }
}
