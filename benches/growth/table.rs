//! Tables of numbers with the slopes at which their columns grow.

/// A column.
#[derive(Clone, Copy)]
pub(crate) struct Column {
    pub(crate) name: &'static str,
    pub(crate) decimals: usize,
    /// Smaller values are lost in the noise and do not count for the slope; infinite for a column without one.
    pub(crate) least: f64,
}

impl Column {
    /// A count.
    pub(crate) const fn count(name: &'static str) -> Self {
        Self { name, decimals: 0, least: 1.0 }
    }

    /// Seconds, which the system counts in hundredths.
    pub(crate) const fn seconds(name: &'static str) -> Self {
        Self { name, decimals: 2, least: 0.1 }
    }

    /// A quantity with `decimals` digits after the point.
    pub(crate) const fn number(name: &'static str, decimals: usize) -> Self {
        Self { name, decimals, least: f64::MIN_POSITIVE }
    }

    /// The same without a slope.
    pub(crate) const fn flat(self) -> Self {
        Self { least: f64::INFINITY, ..self }
    }
}

/// A table whose rows are printed as they come.
pub(crate) struct Table {
    columns: Vec<Column>,
    rows: Vec<Vec<f64>>,
}

const WIDTH: usize = 11;

impl Table {
    /// Prints title and names.
    pub(crate) fn new(title: &str, columns: &[Column]) -> Self {
        let names: String = columns.iter().map(|c| format!("{:>WIDTH$}", c.name)).collect();
        println!("\n{title}\n{:10}{names}", "");
        Self { columns: columns.into(), rows: Vec::new() }
    }

    /// Prints and keeps one value per column behind `label`; what is not a number is shown as a dash.
    pub(crate) fn push(&mut self, label: &str, row: Vec<f64>) {
        let cell = |(value, column): (&f64, &Column)| {
            if value.is_finite() { format!("{value:>WIDTH$.0$}", column.decimals) } else { format!("{:>WIDTH$}", "-") }
        };
        println!("{label:10}{}", row.iter().zip(&self.columns).map(cell).collect::<String>());
        self.rows.push(row);
    }

    /// Prints the slopes of the columns against the first: exponents of the power laws through all rows, and through
    /// the last two.
    pub(crate) fn slopes(&self) {
        let last = self.rows.len().saturating_sub(2);
        for (name, rows) in [("slope", &self.rows[..]), ("at the end", &self.rows[last..])] {
            let cell = |c: usize| {
                let least = self.columns[c].least;
                let points: Vec<_> = rows.iter().map(|r| (r[0], r[c])).filter(|(_, y)| *y >= least).collect();
                slope(&points).map_or(format!("{:>WIDTH$}", ""), |s| format!("{s:>WIDTH$.2}"))
            };
            println!("{name:10}{:>WIDTH$}{}", "", (1..self.columns.len()).map(cell).collect::<String>());
        }
    }
}

/// Least-squares slope of ln y over ln x; none through less than two values of x.
fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let n = points.len() as f64;
    let logs: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let (mx, my) = logs.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / n, b + y / n));
    let (xy, xx) = logs.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + (x - mx) * (y - my), b + (x - mx) * (x - mx)));
    (xx > 1e-9).then(|| xy / xx)
}
