"""The numbers of a usual machine with one mass between motor and rack."""

MACHINE = {
    "X1.backlash": 8e-5,
    "X1.contact_stiffness": 8e5,
    "X1.drive_stiffness": 1.2e6,
    "X1.drive_mass": 0.1,
    "X1.coulomb": 0.3,
    "X1.viscous": 0.8,
}
