//! Photometric data files, LM-63 of 1986, 1991, 1995, 2002 and 2019 → [`Profile`].
//!
//! Keywords and the effect of tilt on the lamp are skipped; intensities leave with multiplier and ballast factor applied.

use crate::scene::{Photometry, Profile};

/// More angles than this in one direction are a fault of the file, not a measurement.
const MOST_ANGLES: f32 = 100_000.0;

/// Reads a file. Fails with what is wrong with it.
pub(super) fn parse(bytes: &[u8]) -> Result<Profile, String> {
    let text = String::from_utf8_lossy(bytes);
    let mut lines = text.lines();
    let mut version = lines.clone().next().unwrap_or_default().trim().to_ascii_uppercase();
    version.retain(|c| !c.is_whitespace());
    let tilt = lines
        .by_ref()
        .find_map(|line| line.trim_start().strip_prefix("TILT").map(|rest| rest.trim_start_matches([' ', '='])))
        .ok_or("it has no line `TILT=`, so it is no LM-63 file or ends too early")?;
    let rest = lines.collect::<Vec<_>>().join(" ");
    let mut numbers = Numbers { words: rest.split(|c: char| c.is_whitespace() || c == ',').filter(|w| !w.is_empty()) };
    if tilt.trim().eq_ignore_ascii_case("INCLUDE") {
        // What tilting does to the lamp itself: the luminaire is baked as it was measured.
        numbers.next("the lamp's geometry")?;
        let count = numbers.count("tilt angles")?;
        numbers.take(2 * count, "tilt factors")?;
    }

    numbers.take(2, "the number of lamps and their lumens")?;
    let multiplier = numbers.next("the multiplier")?;
    let verticals = numbers.count("vertical angles")?;
    let horizontals = numbers.count("horizontal angles")?;
    let photometry = match numbers.next("the type of photometry")? {
        1.0 => Photometry::C,
        2.0 => Photometry::B,
        3.0 => return Err("it is photometry of type A (of car headlamps), and types B and C are read".into()),
        other => return Err(format!("its type of photometry is {other} and none of 1 (C), 2 (B), 3 (A)")),
    };
    numbers.take(4, "the luminaire's size")?;
    let ballast = numbers.next("the ballast factor")?;
    // Before 1995 a second factor; since then reserved, and since 2019 a code for how the file was made.
    let second = numbers.next("the second ballast factor")?;
    let second =
        if version.starts_with("IES") && !version.contains("91") && !version.contains("86") { 1.0 } else { second };
    numbers.next("the input watts")?;

    let vertical = ascending(numbers.take(verticals, "vertical angles")?, "vertical")?;
    let horizontal = ascending(numbers.take(horizontals, "horizontal angles")?, "horizontal")?;
    let factor = multiplier * ballast * second;
    let candela: Vec<f32> =
        numbers.take(verticals * horizontals, "intensities")?.into_iter().map(|c| c * factor).collect();
    if let Some(bad) = candela.iter().find(|c| !(c.is_finite() && **c >= 0.0)) {
        return Err(format!("it has an intensity of {bad} cd"));
    }
    Profile::new(photometry, vertical, horizontal, candela)
}

fn ascending(angles: Vec<f32>, kind: &str) -> Result<Vec<f32>, String> {
    match angles.windows(2).find(|pair| pair[1] <= pair[0]) {
        Some(pair) => Err(format!("its {kind} angles are not in ascending order: {} follows {}", pair[1], pair[0])),
        None => Ok(angles),
    }
}

/// The numbers after the keywords; line breaks mean nothing.
struct Numbers<I> {
    words: I,
}

impl<'a, I: Iterator<Item = &'a str>> Numbers<I> {
    fn next(&mut self, what: &str) -> Result<f32, String> {
        let word = self.words.next().ok_or_else(|| format!("it is truncated: it ends before {what}"))?;
        let value = word.parse::<f32>().map_err(|_| format!("it has `{word}` where {what} should be"))?;
        if value.is_finite() { Ok(value) } else { Err(format!("it has `{word}` where {what} should be")) }
    }

    fn count(&mut self, what: &str) -> Result<usize, String> {
        let value = self.next(&format!("the number of {what}"))?;
        if (1.0..=MOST_ANGLES).contains(&value) { Ok(value as usize) } else { Err(format!("it has {value} {what}")) }
    }

    fn take(&mut self, count: usize, what: &str) -> Result<Vec<f32>, String> {
        // Growing as words come in: a count is no reason to reserve memory for what is not there.
        let mut values = Vec::new();
        for have in 0..count {
            values.push(self.next(what).map_err(|e| if have == 0 { e } else { format!("{e} ({have} of {count})") })?);
        }
        Ok(values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    const BODY: &str = "1 1000 2.0 3 1 1 2 0 0 0\n0.5 0.5 60\n0 45,90\n0\n100 50\n0\n";

    fn peak(text: &str) -> Result<f32, String> {
        parse(text.as_bytes()).map(|p| p.peak())
    }

    fn fault(text: &str, expected: &str) {
        let fault = peak(text).expect_err("the file is broken");
        assert!(fault.contains(expected), "{fault}");
    }

    #[test]
    fn every_version_of_the_format() {
        // Multiplier 2 and ballast factor ½; the second factor counts before 1995 only.
        assert_eq!(peak(&format!("A lamp\nTILT=NONE\n{BODY}")), Ok(50.0));
        assert_eq!(peak(&format!("IESNA91\n[TEST] 1\nTILT=NONE\n{BODY}")), Ok(50.0));
        for first in ["IESNA:LM-63-1995", "IESNA:LM-63-2002", "IES:LM-63-2019"] {
            assert_eq!(peak(&format!("{first}\r\n[TEST] 1\r\nTILT=NONE\r\n{BODY}")), Ok(100.0));
        }
        let tilted = format!("IESNA:LM-63-2002\nTILT=INCLUDE\n1\n2\n0 90\n1 0.9\n{BODY}");
        assert_eq!(peak(&tilted), Ok(100.0));
        assert_eq!(peak(&format!("IESNA:LM-63-2002\nTILT=lamp.tlt\n{BODY}")), Ok(100.0));
        let profile = parse(format!("IES:LM-63-2019\nTILT=NONE\n{BODY}").as_bytes()).expect("it is sound");
        assert!((profile.relative(Vec3::new(1.0, 0.0, -1.0).normalize()) - 0.5).abs() < 1e-5);
    }

    #[test]
    fn broken_files_say_what_is_wrong() {
        let with = |body: &str| format!("IESNA:LM-63-2002\nTILT=NONE\n{body}");
        fault("", "TILT");
        fault("IESNA:LM-63-2002\n", "TILT");
        fault(&with("1 1000 1 3 1"), "truncated");
        fault(&with("1 1000 2.0 3 1 1 2 0 0 0\n1 1 60\n0 45 90\n0\n100 50"), "truncated");
        fault(&with("1 1000 1 3 1 3 2 0 0 0\n1 1 60\n0 45 90\n0\n1 1 1"), "type A");
        fault(&with("1 1000 1 3 1 7 2 0 0 0\n1 1 60\n0 45 90\n0\n1 1 1"), "type of photometry is 7");
        fault(&with("1 1000 1 3 1 1 2 0 0 0\n1 1 60\n0 90 45\n0\n1 1 1"), "ascending");
        fault(&with("1 1000 1 3 1 1 2 0 0 0\n1 1 60\n0 45 90\n0\n1 x 1"), "`x`");
        fault(&with("1 1000 1 3 1 1 2 0 0 0\n1 1 60\n0 45 90\n0\n1 -1 1"), "-1 cd");
        fault(&with("1 1000 1 1e9 1 1 2 0 0 0\n"), "vertical");
        fault(&with("1 1000 1 3 1 1 2 0 0 0\n1 1 60\n0 45 90\n0\n0 0 0"), "zero");
    }
}
