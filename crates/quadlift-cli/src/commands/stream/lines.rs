//! Lines of a file, a pipe or the standard input, one after another.

use std::io::{self, BufRead, Read};

/// The longest line that is read, in bytes.
pub(super) const MAX_LINE: usize = 1 << 26;

/// Reads lines and counts them.
pub(super) struct LineReader<R> {
    input: R,
    number: u64,
    longest: usize,
}

/// A line with its number, from 1.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum NextLine {
    /// A line without its end.
    Text(u64, Vec<u8>),
    /// A line that is longer than [`MAX_LINE`]; it was passed over.
    TooLong(u64),
}

impl<R: BufRead> LineReader<R> {
    /// Reads from here, lines up to [`MAX_LINE`].
    pub(super) fn new(input: R) -> Self {
        Self { input, number: 0, longest: MAX_LINE }
    }

    /// The next line that is not blank; `None` at the end.
    ///
    /// # Errors
    /// What the system says.
    pub(super) fn next_line(&mut self) -> io::Result<Option<NextLine>> {
        loop {
            let mut line = Vec::new();
            let limit = self.longest as u64 + 1;
            if (&mut self.input).take(limit).read_until(b'\n', &mut line)? == 0 {
                return Ok(None);
            }
            self.number += 1;
            if line.last() == Some(&b'\n') {
                line.pop();
            } else if line.len() > self.longest {
                self.skip_to_end_of_line()?;
                return Ok(Some(NextLine::TooLong(self.number)));
            }
            if !line.iter().all(u8::is_ascii_whitespace) {
                return Ok(Some(NextLine::Text(self.number, line)));
            }
        }
    }

    fn skip_to_end_of_line(&mut self) -> io::Result<()> {
        self.input.skip_until(b'\n').map(drop)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_counted_and_blank_ones_passed_over() {
        let mut reader = LineReader { longest: 4, ..LineReader::new(&b"ab\r\n\n  \nlong!!\nabcd\nend"[..]) };
        let text = |number, text: &str| Some(NextLine::Text(number, text.as_bytes().to_vec()));
        assert_eq!(reader.next_line().unwrap(), text(1, "ab\r"));
        assert_eq!(reader.next_line().unwrap(), Some(NextLine::TooLong(4)));
        assert_eq!(reader.next_line().unwrap(), text(5, "abcd"));
        assert_eq!(reader.next_line().unwrap(), text(6, "end"));
        assert_eq!(reader.next_line().unwrap(), None);
    }
}
