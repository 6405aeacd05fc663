from .inertial_system import InertialSystem


class ConservingSystem(InertialSystem):
    pass
