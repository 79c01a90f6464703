# Source me in fish: `source scripts/env.fish`. It takes the environment that scripts/env gives to bash.
set --local root (realpath (dirname (status filename))/..)
for line in (bash -c '. "$1/scripts/env" && env --null' bash $root | string split0)
    set --local pair (string split --max 1 = -- $line)
    switch $pair[1]
        case PWD SHLVL _ OLDPWD
        case '*PATH'
            set --global --export $pair[1] (string split : -- $pair[2])
        case '*'
            set --global --export $pair[1] $pair[2]
    end
end
if string match --quiet "$root/*" -- (command --search ros2); and status is-interactive
    python -m argcomplete.scripts.register_python_argcomplete --shell fish ros2 | source
end
