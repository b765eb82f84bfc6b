//! Draws from a set by weight, such that what is left of the random number can be used again.

/// A discrete distribution.
#[derive(Clone, Debug, Default)]
pub struct Distribution {
    /// Sum of the weights up to and with each member.
    cumulative: Vec<f64>,
}

impl Distribution {
    /// Members are drawn in proportion to `weights`, none of which is negative.
    pub fn new(weights: impl IntoIterator<Item = f64>) -> Self {
        let mut sum = 0.0;
        let add = |weight| {
            sum += weight;
            sum
        };
        Self { cumulative: weights.into_iter().map(add).collect() }
    }

    /// Sum of the weights.
    pub fn total(&self) -> f64 {
        self.cumulative.last().copied().unwrap_or(0.0)
    }

    /// Chance of member `index`.
    pub fn chance(&self, index: usize) -> f64 {
        (self.cumulative[index] - self.before(index)) / self.total()
    }

    /// The member that `u` in 0..1 falls on, and where within its share, 0..=1. There must be members.
    pub fn draw(&self, u: f32) -> (usize, f32) {
        let wanted = f64::from(u) * self.total();
        let index = self.cumulative.partition_point(|&c| c <= wanted).min(self.cumulative.len() - 1);
        let before = self.before(index);
        let share = (self.cumulative[index] - before).max(f64::MIN_POSITIVE);
        (index, ((wanted - before) / share).clamp(0.0, 1.0) as f32)
    }

    fn before(&self, index: usize) -> f64 {
        if index == 0 { 0.0 } else { self.cumulative[index - 1] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn members_are_drawn_by_weight_and_the_rest_is_even() {
        let distribution = Distribution::new([1.0, 0.0, 3.0]);
        assert_eq!(distribution.total(), 4.0);
        assert_eq!([0, 1, 2].map(|i| distribution.chance(i)), [0.25, 0.0, 0.75]);
        assert_eq!(distribution.draw(0.125), (0, 0.5));
        assert_eq!(distribution.draw(0.25), (2, 0.0));
        assert_eq!(distribution.draw(0.625), (2, 0.5));
        assert_eq!(distribution.draw(1.0), (2, 1.0));
    }
}
