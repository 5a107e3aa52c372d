"""Whatever a text holds, it gives a document or a `YamlError`, soon."""

import os
from itertools import pairwise

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sesa2.errors import shown
from sesa2.yaml_reading import MAX_BYTES, MAX_DEPTH, MAX_VALUES, YamlError, read_yaml, read_yaml_file


def bomb(levels=8, width=9):
    """Levels of lists that name the one before several times: a few lines, 9⁸ values."""
    names = [f'n{i}' for i in range(levels)]
    lines = [f'n0: &n0 [{", ".join("x" * width)}]']
    for before, name in pairwise(names):
        lines.append(f'{name}: &{name} [{", ".join([f"*{before}"] * width)}]')
    return '\n'.join(lines)


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('a: {{ TEMPLATE }}', 'line 1, column 5: a mapping as a key, .* was not filled in?'),
        ('? [1, 2]\n: 3', 'line 1, column 3: a list as a key'),
        ('a: 1\nb: 2024-02-31', "line 2, column 4: '2024-02-31' is no date"),
        ('a: !!int x', "line 1, column 4: 'x' is no integer"),
        ('a: !!int ""', "'' is no integer"),
        ('a: !!float x', "'x' is no number"),
        ('a: !!bool x', "'x' is no bool"),
        ('a: !!timestamp x', "'x' is no date"),
        ('a: ' + '9' * 5000, 'line 1, column 4: a number of 5000 characters, expected at most 100'),
        ('a: 0x' + 'f' * 5000, 'a number of 5002 characters'),
        ('[' * 10_000, f'line 1, column {MAX_DEPTH + 1}: is nested deeper than {MAX_DEPTH} levels'),
        ('- ' * 10_000, 'nested deeper'),
        ('{a: ' * 10_000, 'nested deeper'),
        ('a: "\\ud800"', r"line 1, column 4: the character '\\ud800' in a text"),
        ('a: "\\0"', r"the character '\\x00' in a text"),
        ('a: "\\e[2J"', r"the character '\\x1b' in a text"),
        ('a: "\\U99999999"', 'line 1, column 7: cannot be read'),
        ('b: 1\na: \x00', r"line 2, column 4: the character '\\x00' is not allowed"),
        ('a: \ud800', r"line 1, column 4: the character '\\ud800' is not allowed"),
        (b'b: 1\na: caf\xe9', 'line 2, column 7: is not text in UTF-8'),
        (b'\xff\xfea\x00', 'line 1, column 1: is not text in UTF-8'),
        ('%YAML ' + '9' * 5000 + '.1\n--- a', 'line 1, column 7'),
        ('a: &a [1, *a]', r'line 1, column 11: \*a stands within what it names'),
        ('a: &a {b: *a}', r'\*a stands within what it names'),
        (bomb(), f'line 5, column .*: has more than {MAX_VALUES} values'),
        ('[' + '1,' * MAX_VALUES + ']', f'has more than {MAX_VALUES} values'),
        ('#' * (MAX_BYTES + 1), 'is longer than 256 KiB'),
        ('a: &x {b: 1}\nc: {<<: *x}', 'line 2, column 5: << is not read here'),
        ('a: 1\na: 2', "line 2, column 1: the key 'a' stands here a second time"),
        ('1: 2\n0x1: 3', 'line 2, column 1: the key 1 stands here a second time'),
        ('a: {b: [{c: 1, c: 2}]}', "line 1, column 16: the key 'c'"),
        ('a:\tb', r"found character '\\t'"),
        ('a: !!python/object/apply:os.getcwd []', 'could not determine a constructor'),
        ('--- a\n--- b', 'line 2, column 1'),
        ('[1, 2', 'line 1, column 6: expected'),
        ('a: ' + '[x, ' * 5 + 'y' * 1000 + ': !!int "' + 'z' * 1000, '.'),
    ],
    ids=range(36),
)
def test_what_is_wrong_is_told_with_its_place(text, expected):
    with pytest.raises(YamlError, match=expected) as caught:
        read_yaml(text)
    assert len(str(caught.value)) < 400
    str(caught.value).encode()


@pytest.mark.parametrize(
    'text',
    [
        '',
        '{}',
        'a: [1, 2.5, true, null, 2024-02-29, x, "é\\n"]',
        'a: &q [0.0, 1.0]\nb: *q\nc: [*q, *q]',
        'a: .nan\nb: -.inf',
        '!!set {a, b}',
        '[' * MAX_DEPTH + ']' * MAX_DEPTH,
        '[' + '1,' * (MAX_VALUES - 1) + ']',
        '"' + 'x ' * (MAX_BYTES // 2 - 3) + '"',
    ],
    ids=range(9),
)
def test_what_is_right_is_read_as_yaml_reads_it(text):
    expected = yaml.safe_load(text)
    assert repr(read_yaml(text)) == repr(expected)
    assert repr(read_yaml(text.encode())) == repr(expected)
    assert repr(read_yaml(b'\xef\xbb\xbf' + text.encode())) == repr(expected)


_WORDS = st.sampled_from(
    [': ', ', ', '&a ', '\n', '  ', '- ', '? ', '|\n', '\t', '%YAML 1.1\n', '---\n', '2024-01-01 25:00:00']
    + [
        '*a',
        '<<',
        '[',
        ']',
        '{',
        '}',
        '2024-02-31',
        '1:2',
        '0b',
        '0x',
        '.nan',
        '1e999',
        '"\\ud800"',
        '"\\U00110000"',
        "'",
        '"',
        'a',
        'b',
        '=',
        '~',
        '{{X}}',
        '#x',
        '!',
    ]
    + [
        f'!!{kind} '
        for kind in [
            'int',
            'float',
            'bool',
            'binary',
            'timestamp',
            'set',
            'omap',
            'pairs',
            'str',
            'map',
            'seq',
            'merge',
            'null',
        ]
    ]
    + ['!<%ff> ', '!e!x ']
)


@settings(max_examples=1500, deadline=None)
@given(st.one_of(st.text(), st.binary(), st.lists(_WORDS, max_size=25).map(''.join)))
@example('!!int {=: {=: 3}}')
@example('12345678901234567890:' + '1:' * 39 + '1')
def test_any_text_gives_a_document_or_the_error(text):
    try:
        document = read_yaml(text)
    except YamlError as error:
        message = str(error)
    else:
        message = shown(document)
        expected = yaml.safe_load(text.decode('utf-8-sig') if isinstance(text, bytes) else text)
        assert repr(document) == repr(expected)
    assert len(message) < 400
    message.encode()


def test_only_a_regular_file_is_read(tmp_path):
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'loop').symlink_to('loop')
    cases = {
        tmp_path: 'is a folder, expected a file',
        tmp_path / 'pipe': 'is a pipe, expected a file',
        '/dev/zero': 'is a device, expected a file',
        tmp_path / 'loop': 'cannot be read: Too many levels of symbolic links',
        tmp_path / 'none': 'cannot be read: No such file',
        'x' * 5000: 'cannot be read: File name too long',
        'a\0b': 'is no path',
    }
    for path, expected in cases.items():
        with pytest.raises(YamlError, match=expected):
            read_yaml_file(path)
    (tmp_path / 'file').write_text('a: 1')
    (tmp_path / 'link').symlink_to('file')
    assert read_yaml_file(tmp_path / 'link') == {'a': 1}
    with (tmp_path / 'file').open('wb') as file:
        file.truncate(1 << 40)  # a hole: it takes no disk
    with pytest.raises(YamlError, match='longer than 256 KiB'):
        read_yaml_file(tmp_path / 'file')


def test_a_value_is_shown_shortened():
    endless = [1]
    endless.append(endless)
    deep = wide = ['x']
    for _ in range(100_000):
        deep = [deep]
    for _ in range(8):
        wide = [wide] * 9
    for value in (
        endless,
        deep,
        wide,
        'x' * 10**6,
        10**5000,
        dict.fromkeys(range(1000), 'x' * 100),
        '\ud800',
        b'x' * 999,
    ):
        assert len(shown(value)) <= 120
        shown(value).encode()
    assert shown([1, 'two', None]) == "[1, 'two', None]"
    assert shown('\x1b[2J\u202e') == r"'\x1b[2J\u202e'"
