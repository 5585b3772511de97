//! Requests that are lines.

/// Takes the first line out of the input, without its line end `\r`, `\n` or `\r\n`.
pub(super) fn take_line(input: &mut Vec<u8>) -> Option<Vec<u8>> {
    let blank = input.iter().take_while(|byte| matches!(byte, b'\r' | b'\n')).count();
    input.drain(..blank);
    let end = input.iter().position(|byte| matches!(byte, b'\r' | b'\n'))?;
    Some(input.drain(..=end).take(end).collect())
}
