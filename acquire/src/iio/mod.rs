//! Linux Industrial I/O.
