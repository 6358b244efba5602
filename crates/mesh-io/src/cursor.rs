//! Lines and tokens of text formats.

use memchr::memchr2;

/// The lines of a text, numbered from 1; `\n`, `\r\n` and `\r` end a line.
pub(crate) struct Lines<'a> {
    rest: Option<&'a [u8]>,
    number: usize,
}

impl<'a> Lines<'a> {
    pub(crate) fn new(text: &'a [u8], first_number: usize) -> Self {
        Self {
            rest: Some(text),
            number: first_number - 1,
        }
    }

    /// What follows the last line that was given, its ending excluded.
    pub(crate) fn rest(&self) -> &'a [u8] {
        self.rest.unwrap_or_default()
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = (usize, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        let rest = self.rest?;
        self.number += 1;
        let Some(end) = memchr2(b'\n', b'\r', rest) else {
            self.rest = None;
            return Some((self.number, rest));
        };
        let (line, ending) = rest.split_at(end);
        let length = if ending.starts_with(b"\r\n") { 2 } else { 1 };
        self.rest = Some(&ending[length..]);
        Some((self.number, line))
    }
}

/// The words of a line.
#[derive(Clone)]
pub(crate) struct Tokens<'a> {
    rest: &'a [u8],
}

impl<'a> Tokens<'a> {
    pub(crate) fn new(line: &'a [u8]) -> Self {
        Self { rest: line }
    }

    /// Whether no word is left.
    pub(crate) fn is_empty(&self) -> bool {
        self.rest.iter().all(u8::is_ascii_whitespace)
    }
}

impl<'a> Iterator for Tokens<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<Self::Item> {
        let rest = self.rest.trim_ascii_start();
        let end = rest
            .iter()
            .position(u8::is_ascii_whitespace)
            .unwrap_or(rest.len());
        let (token, after) = rest.split_at(end);
        self.rest = after;
        (!token.is_empty()).then_some(token)
    }
}

/// A decimal number, whatever the locale; `nan` and `inf` count as numbers here.
pub(crate) fn number(token: &[u8]) -> Option<f64> {
    std::str::from_utf8(token).ok()?.parse().ok()
}

/// A token as it can be shown in a message: printable, and not longer than a line.
pub(crate) fn shown(token: &[u8]) -> String {
    const LONGEST: usize = 40;
    let text = String::from_utf8_lossy(&token[..token.len().min(LONGEST)]);
    let text: String = text
        .chars()
        .map(|c| if c.is_control() { '?' } else { c })
        .collect();
    if token.len() > LONGEST {
        format!("`{text}…`")
    } else {
        format!("`{text}`")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_numbered_and_lose_each_of_the_three_endings() {
        let lines: Vec<_> = Lines::new(b"a\r\n\nb\r\rc", 1).collect();
        let expected = [(1, &b"a"[..]), (2, b""), (3, b"b"), (4, b""), (5, b"c")];
        assert_eq!(lines, expected);
    }

    #[test]
    fn tokens_are_cut_at_any_white_space() {
        let tokens: Vec<_> = Tokens::new(b" \t v  1\t2 ").collect();
        assert_eq!(tokens, [&b"v"[..], b"1", b"2"]);
    }

    #[test]
    fn a_long_or_unprintable_token_is_shown_safely() {
        assert_eq!(shown(b"a\x00\xff"), "`a?\u{fffd}`");
        assert_eq!(shown(&[b'x'; 50]).chars().count(), 43);
    }
}
