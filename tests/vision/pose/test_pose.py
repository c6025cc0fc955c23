"""Poses from corners, edges and grey values against the renderer's truth, and their covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lab.vision.stills import search_in_turn
from mkdaemon.config.vision import TagPlacement, TargetSection
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.photofit import PhotoFit
from mkdaemon.vision.pose.pose import FLOOR_RANGE, Pose, inverse, largest_variance, solve, turn, with_floor
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.detector import Detector
from mkdaemon.vision.tags.tagmap import TagMap, build
from mksim.scene.light import LightConditions
from tests.vision.views import VGA, View, angle_deg, assert_near, place, shipped

PROJECTION = Projection(VGA)


def cold(view, target):
    tagmap = TagMap((target,))
    found = search_in_turn(Detector(tagmap.whitelist), view.pixels)
    return solve([(tagmap.owners[item.family, item.tag_id][1], item) for item in found], PROJECTION)


def test_points_behind_the_camera_are_not_visible():
    _, visible = PROJECTION.project(np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.001], [0.0, 0.0, 1.0]]))
    assert visible.tolist() == [False, False, True]


@pytest.fixture
def target():
    return shipped("single")


@pytest.mark.parametrize("distance", [0.8, 4.0])
def test_both_solutions_are_found_and_the_better_one_is_true(target, distance):
    view = View(target, place(distance, 0.6))
    better, worse = cold(view, target)
    assert better.rms_px < worse.rms_px
    assert_near(better, view, deg=1.0, m=0.004 * distance)


@pytest.mark.parametrize(("name", "distance"), [("single", 1.0), ("nested", 0.4), ("landing", 1.5)])
def test_edge_fit_is_precise_and_beats_a_bad_start(name, distance):
    target = shipped(name)
    view = View(target, place(distance, 0.4, roll=1.0))
    start = cold(view, target)[0]
    start = replace(start, rotation=turn(start.rotation, np.array([0.03, -0.02, 0.02])))
    fitted = EdgeFit(target, PROJECTION).fit(view.pixels, start)
    assert_near(fitted, view, deg=0.1, m=0.0005 * distance, inliers=0.9)
    assert fitted.rms_px < 0.06


def test_edge_fit_follows_a_tag_larger_than_the_image(target):
    view = View(target, place(0.3, 0.1))
    start = Pose(view.rotation, view.position + np.array([0.003, -0.002, 0.004]), np.eye(6), "edges", 0, 0.0)
    assert_near(EdgeFit(target, PROJECTION).fit(view.pixels, start), view, m=0.0005)


@pytest.mark.parametrize("kind", [EdgeFit, PhotoFit])
@pytest.mark.parametrize("at", [(0.0, 0.0, 2.0), (0.0, 0.0, 0.5), (9.0, 0.0, 2.0), (5.0, 0.0, 8.0)])
def test_a_fit_refuses_an_empty_image_and_a_hopeless_start(target, kind, at):
    start = Pose(np.diag([1.0, -1.0, -1.0]), np.array(at), np.eye(6), "edges", 0, 0.0)
    assert kind(target, PROJECTION).fit(np.full((480, 640), 90, np.uint8), start) is None


DOUBTING = Projection(VGA, aspect_sd=FLOOR_RANGE)


def test_a_wrong_ratio_of_focal_lengths_does_not_turn_into_tilt(target):
    lens = VGA.model_copy(update={"fx": VGA.fx * 1.01, "fy": VGA.fy / 1.01})
    view = View(target, replace(place(0.7, 0.3), intrinsics=lens))
    start = cold(view, target)[0]
    doubting, exact = (EdgeFit(target, camera).fit(view.pixels, start) for camera in (DOUBTING, PROJECTION))
    assert_near(doubting, view, deg=0.5 * angle_deg(exact.rotation, view.rotation))
    assert doubting.rms_px < 0.6 * exact.rms_px


def test_grey_values_polish_a_pose_from_edges(target):
    edge_fit, photo_fit = EdgeFit(target, PROJECTION), PhotoFit(target, PROJECTION)
    edges, polished = [], []
    for k in range(0, 64, 8):
        distance = 2.6 + 0.03 * k
        view = View(target, place(distance, 0.05 + 0.08 * (k % 8), around=0.7 * k, roll=0.4 * k))
        start = Pose(turn(view.rotation, np.full(3, 0.01)), 1.003 * view.position, np.eye(6), "corners", 4, 0.1)
        rough = edge_fit.fit(view.pixels, start)
        fine = photo_fit.polish(view.pixels, rough)
        assert np.linalg.det(fine.covariance) < np.linalg.det(rough.covariance)
        assert (fine.source, fine.loss, fine.points) == (rough.source, rough.loss, rough.points)
        edges.append(np.linalg.norm(rough.position - view.position) / distance)
        polished.append(np.linalg.norm(fine.position - view.position) / distance)
    assert np.mean(polished) < 0.8 * np.mean(edges)


def test_grey_values_do_not_polish_what_they_contradict(target):
    fit, (view, large) = PhotoFit(target, PROJECTION), (View(target, place(far, 0.3)) for far in (3.0, 1.0))
    edges, near = (EdgeFit(target, PROJECTION).fit(seen.pixels, cold(seen, target)[0]) for seen in (view, large))
    elsewhere = replace(edges, rotation=turn(edges.rotation, np.array([0.05, 0.0, 0.0])))
    blank = np.full((480, 640), 90, np.uint8)
    for pixels, pose in (
        (view.pixels, elsewhere),
        (view.pixels, replace(edges, inliers=0.8)),
        (large.pixels, near),
        (blank, edges),
    ):
        assert fit.polish(pixels, pose) is pose


def test_tags_of_two_faces_solve_together():
    faces = ((2, (0, 0, 0.15), (0, 0, 0)), (3, (0, -0.15, 0), (90, 0, 0)))
    tags = tuple(TagPlacement(id=code, size=0.2, position=at, rpy_deg=turned) for code, at, turned in faces)
    target = build([TargetSection(name="box", level=False, tags=tags)], origin="test").targets[0]
    view = View(target, place(1.6, 0.75, around=-np.pi / 2))
    (found,) = cold(view, target)
    assert_near(found, view, deg=0.5, m=0.01)


def test_floor_and_inverse():
    rotation = turn(np.diag([1.0, -1.0, -1.0]), np.array([0.2, 0.1, 0.4]))
    pose = Pose(rotation, np.array([0.3, -0.2, 2.0]), np.zeros((6, 6)), "edges", 100, 0.02)
    covariance = with_floor(pose)
    sight = pose.position / pose.range_m
    assert np.sqrt(sight @ covariance[:3, :3] @ sight) == pytest.approx(FLOOR_RANGE * pose.range_m)
    assert np.sqrt(largest_variance(covariance[3:, 3:])) == pytest.approx(np.radians(0.1))
    back, centre, turned = inverse(pose, covariance)
    assert np.allclose(back @ pose.rotation, np.eye(3))
    assert np.allclose(pose.rotation @ centre + pose.position, 0)
    # Monte Carlo: the propagated covariance is that of drawn poses.
    drawn = np.random.default_rng(5).multivariate_normal(np.zeros(6), covariance, 4000)
    centres = np.array([-turn(pose.rotation, d[3:]).T @ (pose.position + d[:3]) for d in drawn])
    assert np.allclose(np.cov(centres.T), turned[:3, :3], atol=0.15 * np.abs(turned[:3, :3]).max())


def test_covariance_is_honest(target):
    """NEES per degree of freedom of 12 views; the campaign of `python -m lab vision` draws hundreds."""
    fit, noisy, values = EdgeFit(target, PROJECTION), LightConditions(noise_sd=2.0), []
    for k in range(0, 24, 2):
        view = View(target, place(1.0 + 0.12 * k, 0.1 + 0.02 * k, around=0.9 * k, roll=0.7 * k), noisy)
        fitted = fit.fit(view.pixels, cold(view, target)[0])
        error = fitted.position - view.position
        values.append(error @ np.linalg.solve(fitted.covariance[:3, :3], error) / 3)
    assert 0.4 < np.mean(values) < 2.0
