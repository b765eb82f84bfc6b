//! Sparse least squares: values that change little and agree where they should.
//!
//! Minimises Σₛ (Σᵢ cₛᵢ·xᵢ)² + Σᵢ wᵢ·(xᵢ − x⁰ᵢ)² by conjugate gradients on the normal equations with a Jacobi
//! preconditioner (Shewchuk, "An Introduction to the Conjugate Gradient Method Without the Agonizing Pain", 1994).
//! Sequential, hence the same bits on every run.

use glam::DVec3;

/// Bilinear lookups on both sides of a seam.
pub(super) const TERMS: usize = 8;

/// Iterations after which what was reached is good enough.
const MAX_ITERATIONS: usize = 200;

/// The residual may shrink to this share of the first one, squared.
const TOLERANCE: f64 = 1e-8;

/// One equation Σ cᵢ·xᵢ = 0: unknowns and their coefficients.
pub(super) type Equation = [(u32, f32); TERMS];

/// A problem for RGB unknowns.
#[derive(Default)]
pub(super) struct Problem {
    /// What should hold.
    pub(super) equations: Vec<Equation>,
    /// Values x⁰ before.
    pub(super) values: Vec<DVec3>,
    /// Resistance w > 0 of each value to change.
    pub(super) weights: Vec<f64>,
}

impl Problem {
    /// The best values x.
    pub(super) fn solve(&self) -> Vec<DVec3> {
        let n = self.values.len();
        let diagonal = self.diagonal();
        let mut change = vec![DVec3::ZERO; n];
        let mut residual: Vec<DVec3> = self.normal(&self.values, false).into_iter().map(|r| -r).collect();
        let mut direction: Vec<DVec3> = residual.iter().zip(&diagonal).map(|(r, d)| *r / *d).collect();
        let mut energy = dot(&residual, &direction);
        let goal = energy * TOLERANCE;
        for _ in 0..MAX_ITERATIONS {
            if energy.cmple(goal).all() {
                break;
            }
            let image = self.normal(&direction, true);
            let step = ratio(energy, dot(&direction, &image));
            for i in 0..n {
                change[i] += direction[i] * step;
                residual[i] -= image[i] * step;
            }
            let scaled = residual.iter().zip(&diagonal).map(|(r, d)| *r / *d);
            let next = residual.iter().zip(scaled).fold(DVec3::ZERO, |sum, (r, z)| sum + *r * z);
            let keep = ratio(next, energy);
            for i in 0..n {
                direction[i] = residual[i] / diagonal[i] + direction[i] * keep;
            }
            energy = next;
        }
        self.values.iter().zip(change).map(|(x, c)| *x + c).collect()
    }

    /// (CᵀC + W)·x, or CᵀC·x alone.
    fn normal(&self, x: &[DVec3], weighted: bool) -> Vec<DVec3> {
        let mut out: Vec<DVec3> = if weighted {
            x.iter().zip(&self.weights).map(|(x, w)| *x * *w).collect()
        } else {
            vec![DVec3::ZERO; x.len()]
        };
        for equation in &self.equations {
            let mismatch = mismatch(equation, x);
            for &(i, c) in equation {
                out[i as usize] += mismatch * f64::from(c);
            }
        }
        out
    }

    fn diagonal(&self) -> Vec<f64> {
        let mut diagonal = self.weights.clone();
        for &(i, c) in self.equations.iter().flatten() {
            diagonal[i as usize] += f64::from(c).powi(2);
        }
        diagonal
    }
}

/// Σ cᵢ·xᵢ.
pub(super) fn mismatch(equation: &Equation, x: &[DVec3]) -> DVec3 {
    equation.iter().fold(DVec3::ZERO, |sum, &(i, c)| sum + x[i as usize] * f64::from(c))
}

fn dot(a: &[DVec3], b: &[DVec3]) -> DVec3 {
    a.iter().zip(b).fold(DVec3::ZERO, |sum, (a, b)| sum + *a * *b)
}

/// Quotient per channel; a channel that has converged stays where it is.
fn ratio(a: DVec3, b: DVec3) -> DVec3 {
    let channel = |a: f64, b: f64| if b > 0.0 { a / b } else { 0.0 };
    DVec3::new(channel(a.x, b.x), channel(a.y, b.y), channel(a.z, b.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// x₀ = x₁ wanted of 1 and 3 (and channel factors 1, 0 and −2), with equal weights w: each moves by 2/(2 + w).
    #[test]
    fn two_values_meet_halfway() {
        let factors = DVec3::new(1.0, 0.0, -2.0);
        let mut equation = [(0, 0.0); TERMS];
        equation[0] = (0, 1.0);
        equation[1] = (1, -1.0);
        let problem =
            Problem { equations: vec![equation], values: vec![factors, 3.0 * factors], weights: vec![0.5, 0.5] };
        let x = problem.solve();
        let moved = 2.0 / 2.5;
        assert!((x[0] - factors * (1.0 + moved)).length() < 1e-9, "{}", x[0]);
        assert!((x[1] - factors * (3.0 - moved)).length() < 1e-9, "{}", x[1]);
    }

    #[test]
    fn values_that_agree_stay() {
        let mut equation = [(0, 0.0); TERMS];
        equation[0] = (0, 1.0);
        equation[1] = (1, -1.0);
        let values = vec![DVec3::splat(7.0); 2];
        let problem = Problem { equations: vec![equation], values: values.clone(), weights: vec![1.0; 2] };
        assert_eq!(problem.solve(), values);
    }
}
