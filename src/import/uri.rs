//! URIs of buffers and images: data URIs are decoded, everything else names a file beside the document.

use std::path::{Path, PathBuf};

/// What a URI refers to.
pub(super) enum Resource {
    /// Content of a data URI.
    Inline(Vec<u8>),
    /// A file.
    File(PathBuf),
}

/// Resolves `uri` against the document's folder. Fails with the reason if a data URI is malformed or if the scheme is
/// one that would need a network.
pub(super) fn resolve(uri: &str, directory: &Path) -> Result<Resource, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (head, body) = data.split_once(',').ok_or("the data URI has no comma")?;
        return if head.ends_with(";base64") {
            decode_base64(body.as_bytes()).map(Resource::Inline)
        } else {
            Ok(Resource::Inline(decode_percent(body)))
        };
    }
    let name = match uri.split_once("://") {
        Some(("file", name)) => name,
        Some((scheme, _)) => return Err(format!("`{scheme}:` addresses are not fetched")),
        None => uri,
    };
    let name = String::from_utf8(decode_percent(name)).map_err(|_| "the file name is not UTF-8")?;
    let path = directory.join(&name);
    // Some exporters write names unescaped, percent signs and all.
    let literal = directory.join(uri);
    Ok(Resource::File(if !path.exists() && literal.exists() { literal } else { path }))
}

/// Bytes of text with `%20`-like escapes; a malformed escape stands for itself.
fn decode_percent(text: &str) -> Vec<u8> {
    let bytes = text.as_bytes();
    let digit = |i: usize| bytes.get(i).and_then(|b| (*b as char).to_digit(16));
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        match (bytes[i], digit(i + 1), digit(i + 2)) {
            (b'%', Some(high), Some(low)) => {
                out.push((high * 16 + low) as u8);
                i += 3;
            }
            (byte, ..) => {
                out.push(byte);
                i += 1;
            }
        }
    }
    out
}

/// RFC 4648 with either alphabet; padding and line breaks may be missing or present.
fn decode_base64(text: &[u8]) -> Result<Vec<u8>, String> {
    let mut out = Vec::with_capacity(text.len() / 4 * 3);
    let (mut bits, mut count) = (0u32, 0);
    for (position, byte) in text.iter().enumerate() {
        let value = match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            b'=' | b'\n' | b'\r' | b' ' | b'\t' => continue,
            _ => return Err(format!("the base64 data has a foreign character at position {position}")),
        };
        bits = bits << 6 | u32::from(value);
        count += 6;
        if count >= 8 {
            count -= 8;
            out.push((bits >> count) as u8);
            bits &= (1 << count) - 1;
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_follows_the_test_vectors_of_rfc_4648() {
        let check = |text: &str, expected: &str| assert_eq!(decode_base64(text.as_bytes()), Ok(expected.into()));
        check("", "");
        check("Zg==", "f");
        check("Zm8", "fo");
        check("Zm9v", "foo");
        check("Zm9vYg==", "foob");
        check("Zm9v\nYmFy", "foobar");
        assert!(decode_base64(b"Zm9*").is_err());
    }

    #[test]
    fn percent_escapes_are_decoded_and_malformed_ones_kept() {
        assert_eq!(decode_percent("a%20b%2"), b"a b%2");
        assert_eq!(decode_percent("100%"), b"100%");
    }

    #[test]
    fn network_addresses_are_refused() {
        assert!(resolve("https://example.org/a.bin", Path::new(".")).is_err());
    }
}
