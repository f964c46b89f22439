from cascadenorm.cli.json_output import ALIASES, with_aliases


def test_renamed_keys_have_both_names_at_every_depth():
    for former, now in ALIASES.items():
        both = {former: 3, now: 3}
        assert with_aliases({former: 3}) == with_aliases({now: 3}) == both
        assert with_aliases({"results": [{now: 3, "pair": "a"}]}) == {"results": [{**both, "pair": "a"}]}


def test_other_values_stay():
    content = {"first": [1, [2, 3]], "noise": None, "name": "rims"}
    assert with_aliases(content) == content
