//! Little-endian numbers from a binary file; messages name the byte.

use std::path::Path;

use crate::error::ReadError;

/// The bytes of a file that are still to be read.
pub(super) struct Bytes<'a> {
    path: &'a Path,
    all: &'a [u8],
    offset: usize,
}

impl<'a> Bytes<'a> {
    pub(super) fn new(path: &'a Path, all: &'a [u8]) -> Self {
        Self { path, all, offset: 0 }
    }

    /// A problem at the place where reading goes on.
    pub(super) fn error(&self, problem: impl Into<String>) -> ReadError {
        ReadError::new(self.path, problem).in_entry(format!("byte {}", self.offset))
    }

    fn take(&mut self, count: usize, what: &str) -> Result<&'a [u8], ReadError> {
        let rest = &self.all[self.offset..];
        let taken = rest.get(..count).ok_or_else(|| {
            let problem = format!("the file ends {} bytes after this; expected {what}, {count} bytes", rest.len());
            self.error(problem)
        })?;
        self.offset += count;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], ReadError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N, what)?);
        Ok(array)
    }

    pub(super) fn u8(&mut self, what: &str) -> Result<u8, ReadError> {
        self.array(what).map(u8::from_le_bytes)
    }

    pub(super) fn u32(&mut self, what: &str) -> Result<u32, ReadError> {
        self.array(what).map(u32::from_le_bytes)
    }

    pub(super) fn i32(&mut self, what: &str) -> Result<i32, ReadError> {
        self.array(what).map(i32::from_le_bytes)
    }

    pub(super) fn u64(&mut self, what: &str) -> Result<u64, ReadError> {
        self.array(what).map(u64::from_le_bytes)
    }

    /// A finite number.
    pub(super) fn f64(&mut self, what: &str) -> Result<f64, ReadError> {
        let number = f64::from_le_bytes(self.array(what)?);
        if number.is_finite() {
            return Ok(number);
        }
        self.offset -= 8;
        Err(self.error(format!("found {number}; expected {what}, a finite number")))
    }

    pub(super) fn f64s<const N: usize>(&mut self, what: &str) -> Result<[f64; N], ReadError> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.f64(what)?;
        }
        Ok(numbers)
    }

    /// Text up to a NUL byte.
    pub(super) fn text(&mut self, what: &str) -> Result<&'a str, ReadError> {
        let rest = &self.all[self.offset..];
        let Some(length) = rest.iter().position(|&byte| byte == 0) else {
            return Err(self.error(format!("expected {what} and a NUL byte, and the file ends without one")));
        };
        let text = std::str::from_utf8(&rest[..length])
            .map_err(|_| self.error(format!("expected {what}, and it is not UTF-8 text")))?;
        self.offset += length + 1;
        Ok(text)
    }

    /// Passes over `count` records of `size` bytes.
    pub(super) fn skip(&mut self, count: u64, size: u64, what: &str) -> Result<(), ReadError> {
        let left = self.all.len() - self.offset;
        match count.checked_mul(size).and_then(|bytes| usize::try_from(bytes).ok()).filter(|&bytes| bytes <= left) {
            Some(bytes) => {
                self.offset += bytes;
                Ok(())
            }
            None => Err(self.error(format!("expected {count} {what} of {size} bytes; the file has {left} more bytes"))),
        }
    }

    /// That nothing is left.
    pub(super) fn end(&self) -> Result<(), ReadError> {
        let left = self.all.len() - self.offset;
        if left == 0 {
            Ok(())
        } else {
            Err(self.error(format!("expected the end of the file; found {left} more bytes")))
        }
    }
}
