"""What a page shows lives in its address, and nothing else does: no token goes out with a link."""

from types import SimpleNamespace

import panel
import pytest

from gateway.studio import MOST_RANGES, Address, ranges_in, ranges_text


@pytest.fixture
def location(monkeypatch):
    one = SimpleNamespace(search="?recording=voyage+2&range=1.0:2.5&token=secret")
    monkeypatch.setattr(panel, "state", SimpleNamespace(location=one))
    return one


def test_it_is_read_and_what_is_written_stands_beside_the_rest(location):
    here = Address()
    assert here.read("recording") == "voyage 2"
    assert here.read("vessel") is None
    here.write(vessel="as given", range=None)
    assert location.search == "?recording=voyage+2&vessel=as+given"
    here.write(vessel=None, recording=None)
    assert location.search == ""


def test_a_token_is_never_written_back(location):
    here = Address()
    assert here.read("token") is None
    here.write(vessel="now")
    assert "token" not in location.search


def test_a_page_without_an_address_remembers_all_the_same(monkeypatch):
    monkeypatch.setattr(panel, "state", SimpleNamespace(location=None))
    here = Address()
    here.write(boat="Grebe")
    assert here.read("boat") == "Grebe"


def test_ranges_come_back_as_they_were_written():
    ranges = ((0.0, 2.5), (10.0, 12.0))
    assert ranges_in(ranges_text(ranges)) == ranges


@pytest.mark.parametrize("text", [None, "", "x", "1", "1:x", "3:1", "1:2:3", "nan:2"])
def test_what_is_no_range_marks_nothing(text):
    assert ranges_in(text) == ()


def test_more_ranges_than_an_address_holds_are_left_out_of_it():
    many = tuple((float(k), k + 0.5) for k in range(MOST_RANGES + 1))
    assert ranges_text(many) == ""
    assert ranges_text(many[1:]) != ""
