//! The scans of two devices, joined by their timestamps.

/// Rows of one device that wait for their partners: a timestamp \[ns\] and numbers. Their number is bounded.
pub(super) struct Ring {
    width: usize,
    rows: usize,
    cells: Box<[i64]>,
    first: usize,
    len: usize,
}

impl Ring {
    /// Room for `rows` rows, 1 or more, of a timestamp and `numbers` numbers.
    pub(super) fn new(rows: usize, numbers: usize) -> Self {
        let (rows, width) = (rows.max(1), numbers + 1);
        Self { width, rows, cells: vec![0; rows * width].into_boxed_slice(), first: 0, len: 0 }
    }

    /// Adds a row; whether the oldest had to go for it.
    pub(super) fn push(&mut self, timestamp: i64, numbers: impl Iterator<Item = i64>) -> bool {
        let is_full = self.len == self.rows;
        if is_full {
            self.pop();
        }
        let at = (self.first + self.len) % self.rows * self.width;
        let row = self.cells.get_mut(at..at + self.width).unwrap_or_default();
        for (cell, number) in row.iter_mut().zip([timestamp].into_iter().chain(numbers)) {
            *cell = number;
        }
        self.len += 1;
        is_full
    }

    fn front(&self) -> Option<(i64, &[i64])> {
        let at = self.first * self.width;
        let row = self.cells.get(at..at + self.width).filter(|_| self.len > 0)?;
        row.split_first().map(|(timestamp, numbers)| (*timestamp, numbers))
    }

    fn pop(&mut self) {
        self.first = (self.first + 1) % self.rows;
        self.len -= 1;
    }
}

/// Hands out the pairs whose timestamps are at most `within` apart, as the first's timestamp and both rows of numbers;
/// how many rows found no partner.
///
/// With `within` half an interval, each row's partner is the nearest. The result does not depend on how many rows are
/// there at a time.
pub(super) fn join(first: &mut Ring, second: &mut Ring, within: u64, mut each: impl FnMut(i64, &[i64], &[i64])) -> u64 {
    let mut lonely = 0;
    while let (Some((a, a_numbers)), Some((b, b_numbers))) = (first.front(), second.front()) {
        if a.abs_diff(b) <= within {
            each(a, a_numbers, b_numbers);
            first.pop();
            second.pop();
        } else {
            lonely += 1;
            if a < b { first.pop() } else { second.pop() }
        }
    }
    lonely
}
