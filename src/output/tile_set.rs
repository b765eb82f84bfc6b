//! Numbers of tiles as people and programs write them: `0-15`, `3`, `0-3,8`.

use serde::{Deserialize, Serialize};
use std::fmt::{self, Display, Formatter};
use std::ops::Range;
use std::str::FromStr;

/// A set of tiles. Runs are sorted, do not touch, and are never empty.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct TileSet {
    runs: Vec<Range<u32>>,
}

impl TileSet {
    /// The tiles from 0 up to but without `count`.
    pub fn all(count: u32) -> Self {
        Self::from_runs(std::iter::once(0..count).collect())
    }

    /// From runs in any order.
    fn from_runs(mut from: Vec<Range<u32>>) -> Self {
        from.retain(|run| !run.is_empty());
        from.sort_by_key(|run| run.start);
        let mut runs: Vec<Range<u32>> = Vec::new();
        for run in from {
            match runs.last_mut() {
                Some(last) if run.start <= last.end => last.end = last.end.max(run.end),
                _ => runs.push(run),
            }
        }
        Self { runs }
    }

    /// True if it holds no tile.
    pub fn is_empty(&self) -> bool {
        self.runs.is_empty()
    }

    /// Number of tiles.
    pub fn len(&self) -> usize {
        self.runs.iter().map(|run| run.len()).sum()
    }

    /// True if it holds a tile.
    pub fn contains(&self, tile: u32) -> bool {
        self.runs.iter().any(|run| run.contains(&tile))
    }

    /// Tiles of either set.
    pub fn with(&self, other: &Self) -> Self {
        Self::from_runs(self.runs.iter().chain(&other.runs).cloned().collect())
    }

    /// Tiles of this set that the other lacks.
    pub fn without(&self, other: &Self) -> Self {
        let mut left = self.runs.clone();
        for cut in &other.runs {
            let around = |run: Range<u32>| [run.start..run.end.min(cut.start), run.start.max(cut.end)..run.end];
            left = left.into_iter().flat_map(around).collect();
        }
        Self::from_runs(left)
    }
}

impl Display for TileSet {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        for (i, run) in self.runs.iter().enumerate() {
            let comma = if i > 0 { "," } else { "" };
            match run.len() {
                1 => write!(f, "{comma}{}", run.start)?,
                _ => write!(f, "{comma}{}-{}", run.start, run.end - 1)?,
            }
        }
        Ok(())
    }
}

impl FromStr for TileSet {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let fault = || format!("`{text}` is neither a tile, like 3, nor tiles like 0-15 or 0-3,8");
        let number = |t: &str| t.trim().parse::<u32>().ok().filter(|&n| n < u32::MAX).ok_or_else(fault);
        if text.trim().is_empty() {
            return Ok(Self::default());
        }
        let run = |part: &str| {
            let (first, last) = part.split_once('-').unwrap_or((part, part));
            let (first, last) = (number(first)?, number(last)?);
            if first <= last { Ok(first..last + 1) } else { Err(fault()) }
        };
        Ok(Self::from_runs(text.split(',').map(run).collect::<Result<_, String>>()?))
    }
}

impl From<TileSet> for String {
    fn from(tiles: TileSet) -> Self {
        tiles.to_string()
    }
}

impl TryFrom<String> for TileSet {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(text: &str) -> TileSet {
        text.parse().expect("it is well-formed")
    }

    #[test]
    fn runs_are_read_and_written_in_order() {
        let check = |text: &str, expected: &str| assert_eq!(set(text).to_string(), expected, "{text}");
        check("3", "3");
        check("0-15", "0-15");
        check("8, 0-3, 4", "0-4,8");
        check("2-5,4-9", "2-9");
        check("", "");
        for wrong in ["a", "3-1", "-3", "1-", "1,,2", "0-4294967295", "1.5"] {
            assert!(wrong.parse::<TileSet>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn sets_are_joined_and_cut() {
        assert_eq!(set("0-3").with(&set("4-5,9")), set("0-5,9"));
        assert_eq!(set("0-9").without(&set("0,3-4,9-12")), set("1-2,5-8"));
        assert!(set("3").without(&TileSet::all(4)).is_empty());
        assert_eq!(TileSet::all(0), TileSet::default());
        assert_eq!((set("0-3,8").len(), set("0-3,8").contains(8), set("0-3,8").contains(4)), (5, true, false));
    }
}
