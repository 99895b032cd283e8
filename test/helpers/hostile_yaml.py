"""Documents that try to take more than their reader has."""

BOMB = 'a0: &a0 [x, x]\n' + '\n'.join(
    f'a{i}: &a{i} [*a{i - 1}, *a{i - 1}]' for i in range(1, 40))
HOSTILE = {
    'huge': 'a: ' + 'x' * 10**7,
    'deep list': '[' * 20_000,
    'deep mapping': '{a: ' * 20_000,
    'deep block': '\n'.join(' ' * i + 'a:' for i in range(400)),
    'billion laughs': BOMB,
    'endless number': '1' * 200_000,
    'sexagesimal': ':'.join(['59'] * 80_000),
    'endless float': ':'.join(['59'] * 80_000) + '.5',
    'python object': '!!python/object/apply:os.system ["echo hello"]',
    'python name': '!!python/name:os.system',
    'twice': 'mass: 1\nmass: 2',
    'list as key': '? [a, b]\n: c',
    'merge': 'a: {<<: [1, 2]}',
    'binary': '\x00\x01\x02',
}
