//! How a curve's vector and its square matrix are stored: their numbers, column by column. (nalgebra's own form is only
//! there with its feature `std`.)

pub(crate) mod vector {
    use nalgebra::DVector;
    use serde::{Deserialize as _, Deserializer, Serialize as _, Serializer};

    pub(crate) fn serialize<S: Serializer>(vector: &DVector<f64>, serializer: S) -> Result<S::Ok, S::Error> {
        vector.as_slice().serialize(serializer)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<DVector<f64>, D::Error> {
        Vec::deserialize(deserializer).map(DVector::from_vec)
    }
}

pub(crate) mod square {
    use nalgebra::DMatrix;
    use serde::de::Error as _;
    use serde::{Deserialize as _, Deserializer, Serialize as _, Serializer};

    type Square = Option<DMatrix<f64>>;

    pub(crate) fn serialize<S: Serializer>(matrix: &Square, serializer: S) -> Result<S::Ok, S::Error> {
        matrix.as_ref().map(DMatrix::as_slice).serialize(serializer)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Square, D::Error> {
        let Some(numbers) = Option::<Vec<f64>>::deserialize(deserializer)? else { return Ok(None) };
        let side = numbers.len().isqrt();
        if side * side != numbers.len() {
            return Err(D::Error::custom(format!("{} numbers are not a square matrix", numbers.len())));
        }
        Ok(Some(DMatrix::from_vec(side, side, numbers)))
    }
}
