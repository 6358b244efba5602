//! ASCII bodies: one record a line, or records wherever their numbers stand.

use super::binary::list_length;
use super::header::{Element, Kind};
use super::malformed;
use super::read::{Record, Role, Sinks};
use crate::ReadError;
use crate::cursor::{Lines, Tokens, number, shown};

/// What ends a record.
///
/// Files have one record a line, and only that tells which record has a number too many or too
/// few. The format itself asks for numbers between white space only.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RecordEnd {
    /// The end of its line.
    Line,
    /// Its last number, wherever that stands.
    LastNumber,
}

pub(super) struct AsciiBody<'a> {
    record_end: RecordEnd,
    lines: Lines<'a>,
    /// What is left of the current line, and its number.
    tokens: Tokens<'a>,
    line: usize,
    record: Record,
}

impl<'a> AsciiBody<'a> {
    pub(super) fn new(body: &'a [u8], first_line: usize, record_end: RecordEnd) -> Self {
        Self {
            record_end,
            lines: Lines::new(body, first_line),
            tokens: Tokens::new(&[]),
            line: first_line,
            record: Record::default(),
        }
    }

    pub(super) fn read(
        &mut self,
        role: Role,
        element: &Element,
        sinks: &mut Sinks<'_>,
    ) -> Result<(), ReadError> {
        if element.properties.is_empty() {
            return Ok(());
        }
        for record in 0..element.count {
            if !self.find_record() {
                let (name, count) = (&element.name, element.count);
                return Err(malformed(format!(
                    "the file ends before {name} {record} of {count}"
                )));
            }
            if role == Role::Other && self.record_end == RecordEnd::Line {
                continue;
            }
            let line = self.line;
            self.read_record(element, record, sinks.corner_list)?;
            sinks.push(role, &self.record, Some(line))?;
        }
        Ok(())
    }

    /// Whether nothing but white space is left.
    pub(super) fn is_at_end(&mut self) -> bool {
        !self.find_record()
    }

    /// Goes to where the next record begins; false if there is none.
    fn find_record(&mut self) -> bool {
        if self.record_end == RecordEnd::LastNumber && !self.tokens.is_empty() {
            return true;
        }
        self.next_line()
    }

    /// Goes to the next line with something on it; false if there is none.
    fn next_line(&mut self) -> bool {
        for (line, text) in self.lines.by_ref() {
            let tokens = Tokens::new(text);
            if !tokens.is_empty() {
                (self.line, self.tokens) = (line, tokens);
                return true;
            }
        }
        false
    }

    /// Reads one record.
    fn read_record(
        &mut self,
        element: &Element,
        record: u64,
        corner_list: usize,
    ) -> Result<(), ReadError> {
        self.record.scalars.clear();
        for (index, property) in element.properties.iter().enumerate() {
            match property.kind {
                Kind::Scalar(_) => {
                    let scalar = self.number(element, record)?;
                    self.record.scalars.push(scalar);
                }
                Kind::List { .. } => {
                    let length = list_length(self.number(element, record)?, element, record)?;
                    if index == corner_list {
                        self.record.corners.clear();
                    }
                    // The tokens run out long before a hostile length does.
                    for _ in 0..length {
                        let item = self.number(element, record)?;
                        if index == corner_list {
                            self.record.corners.push(item);
                        }
                    }
                    self.record.scalars.push(0.0);
                }
            }
        }
        if self.record_end == RecordEnd::LastNumber {
            return Ok(());
        }
        match self.tokens.next() {
            None => Ok(()),
            Some(token) => Err(malformed(format!(
                "line {}: {} {record} has more numbers than the header says, from {} on",
                self.line,
                element.name,
                shown(token)
            ))),
        }
    }

    /// The next number of a record.
    #[inline]
    fn number(&mut self, element: &Element, record: u64) -> Result<f64, ReadError> {
        let mut token = self.tokens.next();
        if token.is_none() && self.record_end == RecordEnd::LastNumber && self.next_line() {
            token = self.tokens.next();
        }
        let line = self.line;
        let token = token.ok_or_else(|| {
            malformed(format!(
                "line {line}: {} {record} has too few numbers",
                element.name
            ))
        })?;
        number(token)
            .ok_or_else(|| malformed(format!("line {line}: {} is not a number", shown(token))))
    }
}
