//! The table: a valid content with its digest and its kernel.

use super::errors::StatedErrors;
use super::turntable::Turntable;
use crate::kernel::Kernel;
use crate::nominal::nominal_ns;
use crate::polynomial::Polynomial;
use crate::table::content::{Axis, Content, ContentFault};
use crate::table::digest::Digest;
use crate::wire::device;

/// A valid coefficient table with its digest. Two tables are equal if their contents are.
#[derive(Clone, Debug)]
pub struct CoefficientTable {
    content: Content,
    kernel: Kernel,
    digest: Digest,
    id: u64,
    gravity_local: Option<f64>,
    turntable: Option<Turntable>,
    gravity_only: bool,
    has_provenance: bool,
    errors: StatedErrors,
    sealed: bool,
}

impl PartialEq for CoefficientTable {
    fn eq(&self, other: &Self) -> bool {
        self.content == other.content
    }
}

impl CoefficientTable {
    /// Checks `content` and computes its digest.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_shared::table::CoefficientTable;
    ///
    /// let table = CoefficientTable::from_toml(include_str!("../../../tests/data/imu-a.toml"), None)?;
    /// let mut content = table.content().clone();
    /// content.max_age_s = Some(-1.0);
    /// let refusals = CoefficientTable::new(content).err().ok_or("an age is over 0")?;
    /// assert_eq!(refusals[0].key, "temperature.max_age_s");
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// All invalid parts of `content`.
    pub fn new(content: Content) -> Result<Self, Vec<ContentFault>> {
        let refusals = content.refusals();
        if refusals.is_empty() {
            let digest = content.digest();
            let lag_ns = content.lag_s.map_or(0, |lag_s| (lag_s * 1e9).round() as u64);
            let nominal_ns = content.nominal_interval_s.map_or(0, nominal_ns);
            let device = content.serial.as_deref().map_or(0, device);
            Ok(Self {
                kernel: Kernel::new(&content, [lag_ns, nominal_ns], device),
                content,
                id: digest.id(),
                digest,
                gravity_local: None,
                turntable: None,
                gravity_only: false,
                has_provenance: false,
                errors: StatedErrors::default(),
                sealed: false,
            })
        } else {
            Err(refusals)
        }
    }

    /// The content of the table.
    #[must_use]
    #[inline]
    pub const fn content(&self) -> &Content {
        &self.content
    }

    /// Local gravity where the table was measured \[m/s2\], as its provenance says. It is not part of the digest.
    #[must_use]
    pub const fn gravity_local(&self) -> Option<f64> {
        self.gravity_local
    }

    /// The table with the local gravity where it was measured \[m/s2\].
    #[must_use]
    pub const fn measured_at(mut self, gravity_local: Option<f64>) -> Self {
        self.gravity_local = gravity_local;
        self
    }

    /// The turntable that the table was measured on, as its provenance says. It is not part of the digest.
    #[must_use]
    pub const fn turntable(&self) -> Option<&Turntable> {
        self.turntable.as_ref()
    }

    /// The table with the turntable that it was measured on.
    #[must_use]
    pub const fn measured_on(mut self, turntable: Option<Turntable>) -> Self {
        self.turntable = turntable;
        self
    }

    /// Whether the table was measured without a turntable, as its provenance says. It is not part of the digest.
    #[must_use]
    pub const fn is_gravity_only(&self) -> bool {
        self.gravity_only
    }

    /// The table, measured without a turntable.
    #[must_use]
    pub const fn measured_by_hand(mut self) -> Self {
        self.gravity_only = true;
        self
    }

    /// The table of a file that says where it comes from.
    #[must_use]
    pub const fn with_provenance(mut self) -> Self {
        self.has_provenance = true;
        self
    }

    /// What the table states of its own errors, by its provenance. They are not part of the digest.
    #[must_use]
    pub const fn errors(&self) -> &StatedErrors {
        &self.errors
    }

    /// The table that states these errors.
    #[must_use]
    pub const fn stating(mut self, errors: StatedErrors) -> Self {
        self.errors = errors;
        self
    }

    /// Whether the file that the table was read from has its digest.
    #[must_use]
    pub const fn is_sealed(&self) -> bool {
        self.sealed
    }

    /// The table of a file that has its digest.
    #[must_use]
    pub const fn sealed(mut self) -> Self {
        self.sealed = true;
        self
    }

    /// Whether this is no calibration: every curve is a constant, as from a data sheet, and the file does not say where
    /// it comes from.
    #[must_use]
    pub fn is_nominal(&self) -> bool {
        let content = self.content();
        let gyroscopes = content.gyroscopes.iter().flat_map(|gyroscopes| &gyroscopes.axes);
        let constant = |curve: &Polynomial| curve.coefficients().iter().skip(1).all(|coefficient| *coefficient == 0.0);
        let is_constant = |axis: &Axis| {
            axis.transient == 0.0
                && [&axis.bias, &axis.positive_scale_factor, &axis.negative_scale_factor].into_iter().all(constant)
        };
        !self.has_provenance && content.axes.iter().chain(gyroscopes).all(is_constant)
    }

    /// Whether this is a calibration and the table `before` is none: the first calibration of the IMU.
    #[must_use]
    pub fn is_first_calibration_after(&self, before: &Self) -> bool {
        before.is_nominal() && !self.is_nominal()
    }

    /// The table as the kernel reads it.
    #[inline(always)]
    pub(crate) const fn kernel(&self) -> &Kernel {
        &self.kernel
    }

    /// Time constant of the lagged temperature \[ns\], to the nearest one; 0 without lag.
    #[must_use]
    #[inline]
    pub const fn lag_ns(&self) -> u64 {
        self.kernel.lag_ns
    }

    /// The control period that the scale factors are of \[ns\], to the nearest one; 0 if they are of none. See
    /// [`interval_fits`](crate::nominal::interval_fits).
    #[must_use]
    #[inline]
    pub const fn nominal_ns(&self) -> u64 {
        self.kernel.nominal_ns
    }

    /// The number of the device that the table belongs to: [`device`] of its serial number; 0 = unknown.
    #[must_use]
    #[inline]
    pub const fn device(&self) -> u64 {
        self.kernel.device
    }

    /// SHA-256 over everything that affects the numbers or names their IMU; see [`Content::canonical`].
    #[must_use]
    pub const fn digest(&self) -> &Digest {
        &self.digest
    }

    /// The first 8 bytes of the digest, big-endian; every increment carries this number.
    #[must_use]
    #[inline]
    pub const fn id(&self) -> u64 {
        self.id
    }
}
