% settings
bot_center = [9.5,42];  % where it starts
bot_rot = -90;
block_center = [25 41];
blocksize = 6/2;
num_segments = 20;
strength = [0.1, 2];	% how much
step_time = 0;
%{
bot_rot = 51;
%}
randerror = 0;
randbias = 1;
plot_robot = 1; plot_sense = 1;
plot_sense = 0;
bot_perim = import_bot;
[s_cmd, s_rply] = tcp_setup('server', 9100, 9100);
while sim
    bot_center = bot_center_old;
    %fwrite(s_rply, reply, 'double')
    fwrite(s_cmd, reply, 'single')
end
