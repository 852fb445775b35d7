"""Scripted noisy teachers, one per environment; each acts from observations alone and labels what it does."""

TEACHERS: dict[str, str] = {
    "lfd_gym/MoveObject-v0": "scripted_teachers.move_object:MoveObjectTeacher",
    "lfd_gym/LightBulb-v0": "scripted_teachers.light_bulb:LightBulbTeacher",
    "lfd_gym/BoxStacking-v0": "scripted_teachers.box_stacking:BoxStackingTeacher",
    "lfd_gym/BoxFlipping-v0": "scripted_teachers.box_flipping:BoxFlippingTeacher",
    "lfd_gym/Whiteboard-v0": "scripted_teachers.whiteboard:WhiteboardTeacher",
    "lfd_gym/CylinderGrasp-v0": "scripted_teachers.cylinder_grasp:CylinderGraspTeacher",
}
