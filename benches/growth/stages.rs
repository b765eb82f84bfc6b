//! What the stages of bakes took, one table of CPU seconds and one of memory, in rows like those of the table above them.

use crate::bake::{Baked, STAGES};
use crate::table::{Column, Table};

/// Title, value per stage, and column.
type Kind = (&'static str, fn(&Baked, &str) -> f64, fn(&'static str) -> Column);

/// Prints both; each bake comes with the quantity that grows, which `first` names.
pub(crate) fn print(first: Column, bakes: &[(f64, Baked)]) {
    let tables: [Kind; 2] = [
        ("CPU seconds by stage", |b, stage| b.stage(stage, "cpu_s"), Column::seconds),
        ("most MiB resident during a stage", Baked::stage_peak, |stage| Column::number(stage, 1)),
    ];
    for (title, value, column) in tables {
        let columns: Vec<Column> = [first].into_iter().chain(STAGES.map(column)).collect();
        let mut table = Table::new(title, &columns);
        for (size, baked) in bakes {
            table.push("", [*size].into_iter().chain(STAGES.map(|stage| value(baked, stage))).collect());
        }
        table.slopes();
    }
}
