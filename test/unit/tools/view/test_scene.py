# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A robot in a scene of the browser is where its kinematics say, and looks as it is described."""

from xml.etree import ElementTree

import coal
import numpy as np
import pytest
import robots
from tp_controller import Robot
from tp_controller.model.urdf import parse
from tp_controller.tools.view import camera, meshes, parts, scene
from tp_controller.tools.view import visuals as looks
from tp_controller.tools.view.server import PANEL_WIDTH
from tp_controller.tools.view.skeleton import drum, foot, JOINT_COLOUR, limb, pointer, skeleton
import trimesh
import viser

BOX = '<geometry><box size="0.1 0.2 0.3"/></geometry>'
BALL = '<geometry><sphere radius="0.2"/></geometry>'
MISSING = '<geometry><mesh filename="package://no_such_package/a.stl"/></geometry>'


@pytest.fixture(scope='module')
def server():
    """Return a server whose page nobody opens."""
    found = viser.ViserServer('127.0.0.1', 8480, verbose=False)
    yield found
    found.stop()


@pytest.fixture
def stage(server):
    """Return an empty scene."""
    server.scene.reset()
    return server.scene


def two_links(first='', second=''):
    """Return a robot of two links, half a metre apart, with some content."""
    return Robot.from_urdf(
        f'<robot name="r"><link name="a">{first}</link><link name="b">{second}</link>'
        '<joint name="j" type="revolute"><parent link="a"/><child link="b"/>'
        '<origin xyz="0 0 0.5"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>')


def shown_pose(handle):
    """Return the pose that a node of the scene has, from what viser would send."""
    w, x, y, z = handle.wxyz
    R = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                  [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                  [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, handle.position
    return T


def configuration(robot, seed):
    """Return a configuration within the limits, with the base anywhere."""
    random = np.random.default_rng(seed)
    lower, upper = np.maximum(robot.lower, -2.0), np.minimum(robot.upper, 2.0)
    T = np.eye(4)
    angle = random.uniform(-2.0, 2.0)
    T[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    T[:2, 3] = random.uniform(-1.0, 1.0, 2)
    return robot.configuration(random.uniform(lower, upper)[robot.joint_columns], T)


@pytest.mark.parametrize('base', ['fixed', 'planar', 'underwater'])
def test_links_are_shown_where_the_kinematics_have_them(stage, base):
    robot = robots.moving_panda(base) if base != 'fixed' else robots.panda()
    shown = scene.RobotScene(stage, robot, looks=looks.Visuals(skeleton(parse(robot.urdf))))
    assert {'panda_link2', 'panda_link4', 'panda_link7'} <= set(shown.frames)
    for seed in range(3):
        q = configuration(robot, seed)
        shown.show(q)
        state = robot.state(q)
        for link, handle in shown.frames.items():
            np.testing.assert_allclose(shown_pose(handle), state.pose(link), atol=1e-6)


@pytest.mark.slow
def test_passive_joints_move_their_links_too(stage):
    robot = robots.urdf_robot('panda', joints=tuple(f'panda_joint{n}' for n in range(1, 8)))
    shown = scene.RobotScene(stage, robot)
    shown.show(robots.PANDA_READY, [0.03] * len(robot.passive_names))
    expected = robot.state(robots.PANDA_READY, [0.03] * len(robot.passive_names))
    for finger in ('panda_leftfinger', 'panda_rightfinger'):
        np.testing.assert_allclose(shown_pose(shown.frames[finger]), expected.pose(finger),
                                   atol=1e-6)


@pytest.mark.slow
def test_only_links_that_moved_are_sent_again(stage):
    robot = robots.panda()
    shown = scene.RobotScene(stage, robot)
    shown.show(robots.PANDA_READY)
    # What was set by hand stays, unless the link is moved.
    for handle in shown.frames.values():
        handle.position = (9.0, 9.0, 9.0)
    q = np.array(robots.PANDA_READY)
    q[6] += 0.1
    shown.show(q)
    moved = [link for link, handle in shown.frames.items() if handle.position[0] != 9.0]
    assert moved and set(moved) <= {'panda_link7', 'panda_link8', 'panda_hand', 'panda_hand_tcp'}


@pytest.mark.slow
def test_a_robot_that_is_removed_leaves_nothing_behind(stage):
    before = set(stage._handle_from_node_name)
    scene.RobotScene(stage, robots.panda()).remove()
    assert set(stage._handle_from_node_name) == before


def test_visual_shapes_are_shown_before_those_that_collide():
    found = looks.visuals_of(two_links(f'<visual>{BOX}</visual><collision>{BALL}</collision>',
                                       f'<collision>{BALL}</collision>'))
    assert [part.kind for part in found.parts['a']] == ['box']
    assert [part.kind for part in found.parts['b']] == ['sphere']
    assert found.remarks == ()


def test_where_a_mesh_is_missing_the_collision_shape_is_shown_and_it_is_said():
    found = looks.visuals_of(two_links(f'<visual>{MISSING}</visual><collision>{BALL}</collision>'))
    assert [part.kind for part in found.parts['a']] == ['sphere']
    assert len(found.remarks) == 1 and 'no_such_package' in found.remarks[0]


def test_where_nothing_can_be_read_links_are_rods_that_reach_the_next_joint():
    found = looks.visuals_of(two_links(f'<visual>{MISSING}</visual>'))
    limb = found.parts['a'][-1]
    points = limb.mesh.vertices @ limb.T[:3, :3].T + limb.T[:3, 3]
    radius = np.hypot(*points[:, :2].T).max()
    assert 0.01 < radius < 0.05
    assert points[:, 2].min() == pytest.approx(0.0) and 0.5 < points[:, 2].max() < 0.5 + radius


@pytest.mark.parametrize('shape', [
    '<visual/>', '<visual><geometry><box/></geometry></visual>',
    '<visual><geometry><box size="1 2"/></geometry></visual>',
    '<visual><geometry><sphere radius="inf"/></geometry></visual>',
    '<visual><geometry><capsule radius="1" length="2"/></geometry></visual>',
    f'<visual><origin xyz="nan 0 0"/>{BOX}</visual>',
    f'<visual><origin xyz="1e300 0 0"/>{BOX}</visual>',
    f'<visual>{BOX}<material name="m"><color rgba="nan 0 0 1"/></material></visual>'])
def test_shape_that_makes_no_sense_is_named_and_the_others_are_shown(stage, shape):
    shown = scene.RobotScene(stage, two_links(shape, f'<visual>{BALL}</visual>'))
    assert len(shown.remarks) == 1 and shown.remarks[0].startswith('a, visual: ')
    assert [part.kind for part in shown.parts['b']] == ['sphere']
    assert np.isfinite(shown.outer_points()).all() and np.isfinite(shown.ground())


def test_long_chain_of_links_at_one_place_is_drawn():
    links = ''.join(f'<link name="l{number}"/>' for number in range(1000))
    joints = ''.join(
        f'<joint name="j{number}" type="{"continuous" if number == 0 else "fixed"}">'
        f'<parent link="l{number}"/><child link="l{number + 1}"/></joint>'
        for number in range(999))
    found = skeleton(parse(f'<robot name="r">{links}{joints}</robot>'))
    assert len(found) == 1000 and len(found['l1']) == 2


def test_a_link_without_shapes_beside_others_stays_invisible():
    found = looks.visuals_of(two_links(f'<visual>{BOX}</visual>'))
    assert 'b' not in found.parts


def test_joints_of_bare_robots_are_drums_about_their_axes():
    found = looks.visuals_of(two_links())
    drum = found.parts['b'][0]
    np.testing.assert_allclose(np.abs(drum.T[:3, 2]), [0, 1, 0], atol=1e-9)


def test_robot_of_a_dh_table_is_drawn_solid(monkeypatch, tmp_path):
    # Without example-robot-data, as most users are.
    monkeypatch.setattr(looks, 'ROBOTS', tmp_path)
    found = looks.visuals_of(robots.panda())
    kinds = {part.kind for each in found.parts.values() for part in each}
    assert kinds == {'mesh'}
    # Each of the seven joints is there, and the tool; joints and links have colours of their own.
    dark = [link for link, each in found.parts.items()
            if any(part.colour == JOINT_COLOUR for part in each)]
    assert len(dark) == 8
    light = [part for each in found.parts.values() for part in each
             if part.colour == parts.LINK_COLOUR]
    assert len(light) > 8
    # It gets thinner towards the tool.
    widths = [np.hypot(*part.mesh.vertices[:, :2].T).max() for part in light]
    assert widths[0] > 1.5 * widths[-1]


def test_links_stay_as_they_are_where_the_meshes_of_others_are_not_wanted(monkeypatch):
    robots.urdf_path('panda')
    monkeypatch.setenv(looks.MESHES_VARIABLE, looks.OWN)
    assert {part.mesh.glb for each in looks.visuals_of(robots.panda()).parts.values()
            for part in each} == {b''}


@pytest.mark.parametrize('mesh', [
    drum(0.05, 0.2, 0.01), limb(0.05, 0.03, 0.4),
    limb(0.05, 0.03, 0.4, flat=True), foot(0.05, 0.13, 0.02),
    pointer(0.04, 0.01, 0.1)])
def test_surfaces_of_links_are_closed_and_face_outwards(mesh):
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # The volume within is positive, and the areas add up to nothing.
    volume = np.einsum('ij,ij->i', corners.mean(axis=1), normals).sum() / 6.0
    box = np.ptp(mesh.vertices, axis=0).prod()
    assert 0.15 * box < volume < box
    np.testing.assert_allclose(normals.sum(axis=0), 0.0, atol=1e-9)


def test_an_arm_that_rises_has_a_foot_on_the_ground():
    found = skeleton(parse(robots.panda().urdf))
    lowest = min((part.mesh.vertices @ part.T[:3, :3].T + part.T[:3, 3])[:, 2].min()
                 for link in ('panda_link0', 'panda_link1_axis') for part in found[link])
    assert lowest == pytest.approx(0.0, abs=1e-9)
    foot, = found['panda_link0']
    assert np.ptp(foot.mesh.vertices, axis=0)[0] > 0.2


def test_robot_of_a_dh_table_borrows_the_looks_of_the_same_example_robot():
    robots.urdf_path('panda')
    ours, theirs = looks.visuals_of(robots.panda()), looks.visuals_of(robots.urdf_robot('panda'))
    assert [part.mesh for part in ours.parts['panda_link4']] == [
        part.mesh for part in theirs.parts['panda_link4']]
    # The fingers, which the table does not have, are on the hand.
    finger = theirs.parts['panda_leftfinger'][0]
    on_hand = next(part for part in ours.parts['panda_hand'] if part.mesh is finger.mesh)
    state = robots.urdf_robot('panda').state(robots.urdf_robot('panda').neutral())
    np.testing.assert_allclose(
        state.pose('panda_hand') @ on_hand.T, state.pose('panda_leftfinger') @ finger.T,
        atol=1e-9)


@pytest.mark.parametrize('base', ['fixed', 'planar'])
def test_only_a_robot_with_the_same_kinematics_lends_its_looks(base):
    robots.urdf_path('panda')
    text = robots.PANDA_DH.read_text()
    match = looks.matching_robot
    assert match(Robot.from_dh(text, base=base)) is not None
    assert match(Robot.from_dh(text.replace('0.316', '0.317'), base=base)) is None
    assert match(Robot.from_dh(text.replace('joint7', 'joint8'), base=base)) is None
    assert match(Robot.from_dh(text.replace('name: panda\n', 'name: p\n'))) is None


def test_colours_come_from_the_description():
    red = '<material name="m"><color rgba="1 0 0 0.5"/></material>'
    part, = looks.visuals_of(two_links(f'<visual>{BOX}{red}</visual>')).parts['a']
    assert part.colour == (255, 0, 0) and part.opacity == 0.5


@pytest.mark.parametrize('name', ['panda', 'ur5', 'xarm7', 'tiago', 'baxter', 'talos_arm'])
@pytest.mark.slow
def test_meshes_of_example_robots_are_all_found(name):
    pytest.importorskip('collada', reason='needs pip install pycollada')
    found = looks.visuals_of(robots.urdf_robot(name))
    assert found.remarks == ()
    assert any(part.kind == 'mesh' for each in found.parts.values() for part in each)


@pytest.mark.parametrize('name', ['panda', 'ur5'])
@pytest.mark.slow
def test_meshes_are_as_large_as_the_collision_library_reads_them(name):
    pytest.importorskip('collada', reason='needs pip install pycollada')
    tree = parse(robots.urdf_path(name).read_text())
    files = {mesh.get('filename') for mesh in tree.iterfind('link/visual/geometry/mesh')}
    assert files
    for file in sorted(files):
        path = meshes.mesh_path(file)
        mesh = meshes.load_mesh(path)
        bounds = mesh.unit * trimesh.load_scene(path).bounds
        reference = coal.MeshLoader().load(str(path))
        reference.computeLocalAABB()
        box = reference.aabb_local
        np.testing.assert_allclose(bounds, [box.min_, box.max_], atol=1e-3)


def test_mesh_that_leads_out_of_its_package_is_not_read(tmp_path):
    with pytest.raises(FileNotFoundError):
        meshes.mesh_path('package://example-robot-data/../../../../setup.py')


@pytest.mark.parametrize('content', [b'', b'solid nothing\nendsolid nothing\n', b'\0' * 200])
def test_file_that_is_no_mesh_is_refused_with_its_name(tmp_path, content):
    path = tmp_path / 'broken.stl'
    path.write_bytes(content)
    with pytest.raises((ValueError, OSError), match='broken.stl'):
        meshes.load_mesh(path)


def seen(position, target, points):
    """Return where points are in the first picture, from -1 to 1 across its height."""
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    x, y, z = np.array([right, np.cross(right, forward), forward]) @ (points - position).T
    assert (z > 0.0).all()
    return np.array([x, y]) / z / np.tan(0.5 * camera.FIELD_OF_VIEW)


# Where the demos start: on wheels with the arm up, and far below the root.
STARTS = {'mobile_arm.urdf': ('planar', (0.0, 0.0, 0.0)),
          'underwater_arm.urdf': ('floating', (1.0, 0.0, -3.0)),
          'two_arms.urdf': ('fixed', None), 'panda.yaml': ('fixed', None)}


@pytest.mark.parametrize('name', sorted(STARTS))
def test_first_view_has_all_of_the_robot_in_it_and_little_else(stage, name):
    base, place = STARTS[name]
    robot = Robot.from_file(robots.CONFIG / 'robots' / name, base=base)
    shown = scene.RobotScene(stage, robot)
    T = np.eye(4)
    T[:3, 3] = place or (0.0, 0.0, 0.0)
    joints = robot.neutral() if place is None else robot.configuration(
        np.zeros(len(robot.joint_names)), T)
    shown.show(joints)
    view = camera.first_view(shown.outer_points())
    origins = seen(*view, np.array([shown.state.position(link) for link in shown.frames]))
    assert np.abs(origins).max() < 0.9
    picture = seen(*view, shown.outer_points())
    assert np.abs(picture).max() < 0.95
    assert np.ptp(picture, axis=1).max() > 0.8


@pytest.mark.parametrize('width, height', [(800, 600), (1280, 800), (1920, 1080)])
@pytest.mark.parametrize('name', sorted(STARTS))
def test_first_view_has_the_robot_beside_the_panel(stage, name, width, height):
    base, place = STARTS[name]
    robot = Robot.from_file(robots.CONFIG / 'robots' / name, base=base)
    shown = scene.RobotScene(stage, robot)
    T = np.eye(4)
    T[:3, 3] = place or (0.0, 0.0, 0.0)
    for turn in (0.0, 1.0):
        shown.show(robot.configuration(np.full(len(robot.joint_names), turn), T)
                   if robot.moves else np.clip(np.full(robot.n, turn), robot.lower, robot.upper))
        points = shown.outer_points()
        view = camera.first_view(points, moves=robot.moves)
        x, y = seen(*view, points)
        # The scene is as wide as the panel leaves.
        assert np.abs(x).max() < (width - PANEL_WIDTH) / height and np.abs(y).max() < 0.95


class Leg:
    """A robot whose root is its pelvis, with a foot of some shape below a knee."""

    FEET = {'box': ('<box size="0.2 0.1 0.06"/>', 0.03), 'sphere': ('<sphere radius="0.1"/>', 0.1),
            'wheel': ('<cylinder radius="0.15" length="0.04"/>', 0.15)}

    def __init__(self, foot='box', height=-1.0):
        shape, self.depth = self.FEET[foot]
        # Its own axis is that of the knee, as a wheel's is.
        upright = ' rpy="1.5707963267948966 0 0"' if foot == 'wheel' else ''
        self.robot = Robot.from_urdf(
            '<robot name="leg"><link name="pelvis"/><link name="foot"><visual>'
            f'<origin xyz="0 0 0"{upright}/><geometry>{shape}</geometry></visual></link>'
            '<joint name="knee" type="continuous"><parent link="pelvis"/><child link="foot"/>'
            f'<origin xyz="0 0 {height}"/><axis xyz="0 1 0"/>'
            '<limit velocity="1" effort="1"/></joint></robot>')


@pytest.mark.parametrize('foot', sorted(Leg.FEET))
def test_a_robot_whose_root_is_its_pelvis_stands_on_the_ground(stage, foot):
    leg = Leg(foot)
    shown = scene.RobotScene(stage, leg.robot)
    assert shown.ground() == pytest.approx(-1.0 - leg.depth)
    ground = scene.add_ground(stage, shown.ground())
    assert ground.position[2] == pytest.approx(-1.0 - leg.depth)


def test_a_wheel_that_has_turned_stands_on_the_same_ground_and_a_box_on_its_edge(stage):
    shown = {}
    for name in ('wheel', 'box'):
        shown[name] = scene.RobotScene(stage, Leg(name).robot, name=f'/{name}')
        shown[name].show([0.7])
    assert shown['wheel'].ground() == pytest.approx(-1.15)
    edge = 0.1 * np.sin(0.7) + 0.03 * np.cos(0.7)
    assert shown['box'].ground() == pytest.approx(-1.0 - edge)


def test_ground_is_never_above_the_root(stage):
    assert scene.RobotScene(stage, Leg(height=1.0).robot).ground() == 0.0


@pytest.mark.slow
@pytest.mark.parametrize('name', ['panda', 'ur5', 'xarm7', 'tiago'])
def test_ground_stays_at_the_base_of_a_robot_that_is_fixed_there(stage, name):
    pytest.importorskip('collada', reason='needs pip install pycollada')
    shown = scene.RobotScene(stage, robots.urdf_robot(name))
    assert shown.ground() == pytest.approx(0.0, abs=5e-3)


@pytest.mark.slow
def test_ground_stays_at_the_base_of_an_arm_that_reaches_below_it(stage):
    base = '<visual><origin xyz="0 0 0.15"/><geometry><box size="1 1 0.3"/></geometry></visual>'
    beam = '<visual><geometry><box size="0.1 0.1 2"/></geometry></visual>'
    shown = scene.RobotScene(stage, two_links(base, beam))
    shown.show([0.2])
    assert shown.ground() == 0.0
    # At zero its wrist is below its base.
    arm = scene.RobotScene(stage, robots.urdf_robot('ur5'), name='/arm')
    assert arm.state.position('wrist_3_link')[2] < 0.0
    assert arm.ground() == 0.0


@pytest.mark.slow
def test_talos_stands_on_its_soles(stage):
    robot = robots.urdf_robot('talos')
    shown = scene.RobotScene(stage, robot)
    soles = [shown.state.position(f'{side}_sole_link')[2] for side in ('left', 'right')]
    assert min(soles) < -1.0
    assert shown.ground() == pytest.approx(min(soles), abs=5e-3)


def test_trail_ends_where_the_frame_is_and_has_a_longest_length(stage):
    trail = scene.Trail(stage, '/trail')
    for number in range(scene.MOST_TRAIL_POINTS + 50):
        trail.add(np.array([0.01 * number, 0.0, 0.0]))
    points = stage.get_handle_by_name('/trail').points
    assert len(points) == scene.MOST_TRAIL_POINTS - 1
    np.testing.assert_allclose(points[-1, 1], [0.01 * (scene.MOST_TRAIL_POINTS + 49), 0.0, 0.0],
                               rtol=1e-6)
    np.testing.assert_allclose(points[1:, 0], points[:-1, 1])


def test_urdf_of_a_dh_table_is_bare_and_that_of_a_real_robot_is_not():
    assert looks._is_bare(parse(robots.panda().urdf))
    assert not looks._is_bare(parse(robots.urdf_path('panda').read_text()))
    assert not looks._is_bare(ElementTree.fromstring(
        f'<robot name="r"><link name="a"><visual>{BOX}</visual></link></robot>'))
    assert parts.LINK_COLOUR != JOINT_COLOUR
